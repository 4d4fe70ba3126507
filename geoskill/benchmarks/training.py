"""``python -m geoskill.benchmarks.training``: times and memory of one step of training on a frame."""

from geoskill.benchmarks.command import run_benchmark

if __name__ == "__main__":
    run_benchmark("training")
