"""What differs every time that the same is computed, and what is measured in the data although it is a time."""

from __future__ import annotations

import pytest

from experiments.analysis.runs.timing import base_name, is_timing


@pytest.mark.parametrize(
    "name",
    [
        *(
            "training_s",
            "evaluation_s_std_over_jobs",
            "runtime_s",
            "runtime_s_median",
            "multistart/runtime_s_p95",
        ),
        *("images_per_s", "frames_per_s", "peak_memory_mb", "seconds_per_frame", "reconstruction_s"),
        *("jobs_resumed", "simulation_s_mean", "elapsed_s"),
    ],
)
def test_runtimes_rates_and_memory_are_known(name: str) -> None:
    assert is_timing(name)


@pytest.mark.parametrize(
    "name",
    [
        *("dsc_mean", "hd95_px_std", "tre_mm", "lag_s", "tracker_lag_s", "offset_s", "time_s", "runtime_s_n"),
        *("megabytes", "epochs", "success_tre_rate", "pieces_left_out_mean", "max_gap_s", "jobs"),
    ],
)
def test_what_is_measured_in_the_data_is_none_of_them(name: str) -> None:
    assert not is_timing(name)


def test_a_statistic_and_the_groups_before_it_do_not_change_the_quantity() -> None:
    assert base_name("unet augmentation:strong/usgra/hd95_px_ci_low") == "hd95_px"
    assert base_name("dsc_std_std_over_jobs") == "dsc"
