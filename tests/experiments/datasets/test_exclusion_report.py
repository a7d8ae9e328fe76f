import pandas as pd

from experiments.datasets.exclusion_report import write_report


class WithTables:
    def report(self) -> dict[str, pd.DataFrame]:
        return {
            "pruned": pd.DataFrame([{"case": "a", "rule": "dark"}]),
            "empty": pd.DataFrame(columns=["case", "rule"]),
        }


def test_each_table_is_a_file_and_an_empty_one_keeps_its_columns(tmp_path) -> None:
    assert write_report(WithTables(), tmp_path) == (tmp_path / "pruned.csv", tmp_path / "empty.csv")
    assert (tmp_path / "pruned.csv").read_text() == "case,rule\na,dark\n"
    assert (tmp_path / "empty.csv").read_text() == "case,rule\n"


def test_a_data_set_that_chooses_nothing_writes_nothing(tmp_path) -> None:
    assert write_report(object(), tmp_path) == ()
    assert not list(tmp_path.iterdir())
