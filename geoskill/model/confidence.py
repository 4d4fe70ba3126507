"""The confidence that an association is right.

The select-out g distributes the weight of a frame over its associations and always sums to 1, also when every
association of the frame is wrong. The confidence depends on the margin instead: how far a score is above the mean of
the frame, relative to the margin that the best score had in the demonstration::

    x = (b - mean b) / reference margin        confidence = 1 / (1 + exp(-PLATT_SLOPE (x - PLATT_MIDPOINT)))

x does not change when all scores are shifted or scaled, so it does not depend on the network that made them. A feature
that is hidden, or replaced by another object, is less similar to the demonstration, and its score has a smaller margin.

Any picture has a best association, and even in white noise its margin is half of the reference. So a score is also
compared with the level, the mean score in the demonstration: the best of a picture that shows nothing of the task is
hardly above what an arbitrary pair of the demonstration's own features has::

    y = (b - level) / reference margin        times 1 / (1 + exp(-FAMILIARITY_SLOPE (y - FAMILIARITY_MIDPOINT)))

The network is the same in both, so that y, too, does not change when all of its scores are shifted or scaled.

The constants are logistic regressions (Platt 1999) of whether the best association of a frame is right; a frame in
which the right association is not visible counts as wrong (docs/experiments/confidence.md, whose script
docs/experiments/fit_confidence.py fits them). They are calibrated for skills that have learned the right task: a skill
that misunderstood its demonstration is just as confident.
"""

import torch
from jaxtyping import Float
from torch import Tensor

PLATT_SLOPE = 9.9
PLATT_MIDPOINT = 0.55
FAMILIARITY_SLOPE = 33.0
FAMILIARITY_MIDPOINT = 0.26


def score_margins(scores: Float[Tensor, " m"]) -> Float[Tensor, " m"]:
    """Return by how much each score b of a frame exceeds their mean.

    >>> score_margins(torch.tensor([1.0, 2.0, 6.0]))
    tensor([-2., -1.,  3.])
    """
    return scores - scores.mean()


def confidences(
    scores: Float[Tensor, " m"], reference_margin: Float[Tensor, ""], reference_level: Float[Tensor, ""] | None = None
) -> Float[Tensor, " m"]:
    """Return the probability that each association of a frame is right.

    The probabilities do not sum to 1, since many pairs of points join the same two objects.

    Args:
        scores: b of all associations of the frame.
        reference_margin: the median margin of the best association in the frames of the demonstration; 0 when it was
            not fitted, as after an interrupted training. The result is then the select-out.
        reference_level: the median over the demonstration's frames of the mean score; None where it is not known, and
            the scores are then compared with each other only.

    One association with the reference margin, and two with less:

    >>> confidences(torch.tensor([6.0, 3.0, 0.0]), torch.tensor(3.0)).round(decimals=4)
    tensor([0.9885, 0.0043, 0.0000])

    The same scores in a frame of which nothing is like the demonstration, whose scores were higher:

    >>> confidences(torch.tensor([6.0, 3.0, 0.0]), torch.tensor(3.0), torch.tensor(6.0)).round(decimals=4)
    tensor([0.0002, 0.0000, 0.0000])
    """
    if reference_margin <= 0:
        return torch.softmax(scores, dim=0)
    confidence = torch.sigmoid(PLATT_SLOPE * (score_margins(scores) / reference_margin - PLATT_MIDPOINT))
    if reference_level is None:
        return confidence
    excess = (scores - reference_level) / reference_margin
    return confidence * torch.sigmoid(FAMILIARITY_SLOPE * (excess - FAMILIARITY_MIDPOINT))
