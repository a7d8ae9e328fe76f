from pathlib import Path

import pytest

from experiments.datasets.musv_subjects import Volunteer, read_volunteers
from experiments.errors import InputError

TABLE = "seq,volunteer,district\n001,anna,carotid\n002,anna,femoral\n003,ben,femoral\n"


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_reads_volunteer_and_district_by_sequence(tmp_path) -> None:
    found = read_volunteers(written(tmp_path / "s.csv", TABLE), ["001", "003"])
    assert found["001"] == Volunteer("anna", "carotid") and found["003"] == Volunteer("ben", "femoral")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("seq,volunteer\n001,anna\n", "expected columns seq, volunteer, district, received seq, volunteer"),
        (TABLE + "001,ben,carotid\n", "expected one row for sequence '001', found two"),
        ("seq,volunteer,district\n001,,carotid\n", "expected a volunteer for sequence '001', received none"),
        (
            "seq,volunteer,district\n001,anna,neck\n",
            "district carotid or femoral for sequence '001', received 'neck'",
        ),
        (TABLE, "expected a row for sequence '004', found none"),
    ],
)
def test_refuses_a_table_by_name(tmp_path, table: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"s\.csv: .*{message}"):
        read_volunteers(written(tmp_path / "s.csv", table), ["001", "004"])
