"""The properties that all extractors of the package share."""

import inspect
from importlib import import_module

import numpy as np
import pytest

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.lbd import Lbd
from geoskill.features.orb import Orb
from geoskill.features.patch import PixelPatch
from geoskill.features.sift import Sift

EXTRACTORS = [Lbd, Orb, PixelPatch, Sift]


@pytest.mark.parametrize("extractor", EXTRACTORS)
def test_name_is_that_of_the_file(extractor: type[FeatureExtractor]) -> None:
    assert extractor.__module__ == f"geoskill.features.{extractor.name}"
    assert getattr(import_module(extractor.__module__), extractor.__name__) is extractor


@pytest.mark.parametrize("extractor", EXTRACTORS)
def test_arguments_are_plain_keywords_kept_as_attributes(extractor: type[FeatureExtractor]) -> None:
    parameters = inspect.signature(extractor).parameters.values()
    assert {parameter.kind for parameter in parameters} == {inspect.Parameter.KEYWORD_ONLY}
    assert {type(parameter.default) for parameter in parameters} <= {bool, int, float, str}
    assert vars(extractor()) == {parameter.name: parameter.default for parameter in parameters}


@pytest.mark.parametrize("extractor", EXTRACTORS)
def test_has_orientation_tells_whether_feature_sets_have_it(extractor: type[FeatureExtractor]) -> None:
    picture = np.zeros((120, 120), np.uint8)
    picture[40:80, 40:80] = 200
    features = extractor().extract(picture)
    assert len(features) > 0
    assert (features.orientation_px is not None) is extractor.has_orientation
    assert features.descriptors.shape[1] == extractor.descriptor_dim
