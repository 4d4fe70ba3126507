# For a processor alone:   docker build -t geoskill --build-arg TORCH_INDEX=URL .    (pytorch.org/get-started has the URL)
# For an NVIDIA GPU:       docker build -t geoskill .     (run with --gpus all; the host needs its container toolkit)
# Then:                    docker run --rm -v "$PWD:/work" geoskill geoskill-train task=video task.path=demo.mp4
FROM python:3.12-slim

# EGL renders the simulated tasks; the last one is Mesa's, for machines without a GPU.
RUN apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri && rm -rf /var/lib/apt/lists/*

# Where PyTorch comes from: empty for the default, whose build for Linux has CUDA.
ARG TORCH_INDEX=
ENV VIRTUAL_ENV=/opt/geoskill/venv
ENV PATH=/opt/geoskill/venv/bin:$PATH

COPY pyproject.toml constraints.txt README.md LICENSE /opt/geoskill/source/
COPY conf /opt/geoskill/source/conf
COPY geoskill /opt/geoskill/source/geoskill

RUN python3 -m venv /opt/geoskill/venv
RUN pip install --no-cache-dir ${TORCH_INDEX:+--index-url $TORCH_INDEX} "$(grep '^torch==' /opt/geoskill/source/constraints.txt)"
RUN pip install --no-cache-dir -c /opt/geoskill/source/constraints.txt "/opt/geoskill/source[datasets,ros2]"

WORKDIR /work
CMD ["geoskill-doctor"]
