"""Configurations of San Raffaele: which data set a name stands for."""

from __future__ import annotations

import pytest

from experiments.analysis.segmentation.configurations import CONFIGURATIONS, configured
from experiments.datasets.san_raffaele import SanRaffaele
from experiments.datasets.usgra import Usgra
from experiments.errors import InputError


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_a_configuration_is_the_data_set_of_that_name_with_the_same_test_subjects(name: str) -> None:
    whole = SanRaffaele("none", test_subjects=["a", "b"], simulate=True)
    found = configured(whole, [name])
    assert found.name == f"san_raffaele_{name}"
    assert found.test_subjects == whole.test_subjects
    assert found.simulate


def test_another_data_set_or_name_is_refused() -> None:
    with pytest.raises(InputError, match="dataset: expected san_raffaele, which has configurations"):
        configured(Usgra("none"), ["full"])
    for names in (["half"], [], ["full", "pruned"]):
        with pytest.raises(InputError, match="configurations: expected each one of single_session, full"):
            configured(SanRaffaele("none"), names)
