"""What a demonstration says of what was learned from it."""

import pytest

from geoskill.model.evidence import MIN_APPROACHED, Evidence


@pytest.mark.parametrize(
    ("approached", "found", "reliance"),
    [(0.0, False, 0.0), (0.25, False, 0.5), (MIN_APPROACHED, True, 1.0), (1.0, True, 1.0)],
)
def test_found_and_reliance_by_the_share_of_frames(approached: float, found: bool, reliance: float) -> None:
    evidence = Evidence(approached, 0.5, 3.0)
    assert (evidence.found, evidence.reliance) == (found, reliance)


def test_evidence_in_words_and_plain_values() -> None:
    right, wrong = Evidence(0.975, 0.064, 120.0), Evidence(0.04, 1.0, 2.0)
    assert str(right) == "the selected features come together in 98% of the frames, to 6% of their distance"
    assert str(wrong).startswith("nothing was learned: ")
    assert right.as_plain() == {
        "found": True,
        "approached": 0.975,
        "end_over_start": 0.064,
        "approaching_instances": 120.0,
    }
