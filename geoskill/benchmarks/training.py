"""``python -m geoskill.benchmarks.training``: time and memory of one training step on one frame."""

from geoskill.benchmarks.command import run_benchmark

if __name__ == "__main__":
    run_benchmark("training")
