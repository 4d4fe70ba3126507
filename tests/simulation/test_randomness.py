"""Random numbers by purpose."""

import numpy as np

from geoskill.simulation.randomness import generator


def test_the_same_purpose_draws_the_same_and_any_other_something_else() -> None:
    first = generator(3, "print", 1).random(4)
    np.testing.assert_array_equal(generator(3, "print", 1).random(4), first)
    for other in (generator(4, "print", 1), generator(3, "print", 2), generator(3, "print"), generator(3)):
        assert not np.any(other.random(4) == first)


def test_the_numbers_are_those_of_every_machine_and_run() -> None:
    # 0x4475FAA4 is the CRC-32 of "sorting looks". Python's own hash of a text would differ from run to run.
    expected = np.random.default_rng([0, 0x4475FAA4]).random(3)
    np.testing.assert_array_equal(generator(0, "sorting", "looks").random(3), expected)
