import pytest

from experiments.datasets.group_table import GroupRow, read_groups, spacing_pair, write_groups
from experiments.errors import InputError

ROWS = {
    "b": GroupRow("p1", (0.1, 0.2), "test", "b 1"),
    "a": GroupRow("p,2", None, "cross-validation"),
}


def test_what_was_written_is_read_in_its_order(tmp_path) -> None:
    write_groups(tmp_path / "groups.csv", ROWS)
    assert list(read_groups(tmp_path / "groups.csv", {"a", "b"}).items()) == list(ROWS.items())
    assert list(read_groups(tmp_path / "groups.csv", {"a"})) == ["a"]


def test_columns_without_a_value_are_left_out(tmp_path) -> None:
    write_groups(tmp_path / "groups.csv", {"a": GroupRow("p")})
    assert (tmp_path / "groups.csv").read_text() == "case,group\na,p\n"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (None, r"groups\.csv: expected a table with columns case, group, found no file"),
        ("name,subject\na,1\n", r"groups\.csv: expected columns case, group, received name, subject"),
        ("case,group\na,p\n", r"groups\.csv: expected a group for image 'b', found none"),
        ("case,group\na,p\nb,\n", r"groups\.csv: expected a group for image 'b', found none"),
        ("case,group\na,p\nb,q\na,q\n", r"groups\.csv: expected one row for each case, received two for 'a'"),
        ("case,group,role\na,p,train\nb,q,\n", r"a: expected role cross-validation, selection, test or none"),
        ("case,group,vertical_mm,horizontal_mm\na,p,1,\nb,q,,\n", r"a: expected two pixel sizes in mm"),
        (
            "case,group,vertical_mm,horizontal_mm\na,p,1,-1\nb,q,,\n",
            r"a: expected positive pixel sizes in mm",
        ),
    ],
)
def test_refuses_a_table_by_name(tmp_path, table: str | None, message: str) -> None:
    if table is not None:
        (tmp_path / "groups.csv").write_text(table)
    with pytest.raises(InputError, match=message):
        read_groups(tmp_path / "groups.csv", {"a", "b"})


def test_pixel_sizes_are_two_positive_numbers() -> None:
    assert spacing_pair(["0.5", 2], "here") == (0.5, 2.0)
    for sides in ([1], [1, 2, 3], [0, 1], [1, float("inf")], ["x", 1]):
        with pytest.raises(InputError, match="here: expected"):
            spacing_pair(sides, "here")
