"""``python -m geoskill.benchmarks.select_out``: time and memory of the scores of one frame and their softmax."""

from geoskill.benchmarks.command import run_benchmark

if __name__ == "__main__":
    run_benchmark("select_out")
