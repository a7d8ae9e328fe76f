"""What lies under a path as one digest: every change of what is read is seen, and nothing else."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from experiments.errors import InputError
from experiments.running.content_hash import ABSENT, content_digest


@pytest.fixture
def data(home: Path) -> Path:
    folder = home / "data"
    for part in ("images", "masks"):
        (folder / part).mkdir(parents=True)
        for name in ("a", "b"):
            (folder / part / f"{name}.png").write_bytes(f"{part} {name}".encode())
    (folder / "groups.csv").write_text("case,group\na,1\nb,2\n")
    return folder


def test_a_change_inside_a_folder_is_another_content(data: Path) -> None:
    seen = [content_digest(data)]
    mask = data / "masks" / "a.png"
    before = mask.stat()
    mask.write_bytes(b"masks A")  # as long as before
    os.utime(mask, ns=(before.st_atime_ns, before.st_mtime_ns))
    seen.append(content_digest(data))
    (data / "masks" / "c.png").write_bytes(b"masks c")
    seen.append(content_digest(data))
    (data / "masks" / "c.png").rename(data / "masks" / "d.png")
    seen.append(content_digest(data))
    (data / "masks" / "d.png").rename(data / "images" / "d.png")
    seen.append(content_digest(data))
    (data / "groups.csv").unlink()
    seen.append(content_digest(data))
    assert len(set(seen)) == len(seen)


def test_what_no_reader_takes_is_left_out(data: Path) -> None:
    before = content_digest(data)
    for junk in (
        ".DS_Store",
        "Thumbs.db",
        "desktop.ini",
        "~$notes.docx",
        "a.png~",
        "._a.png",
        "cache.h5",
        "x.zip",
    ):
        (data / "images" / junk).write_bytes(b"junk")
    for folder in (".ipynb_checkpoints", "__MACOSX", ".git"):
        (data / folder).mkdir()
        (data / folder / "a.png").write_bytes(b"junk")
    assert content_digest(data) == before
    # Among transforms, where no image lies, the same suffix counts.
    (data / "transforms").mkdir()
    (data / "transforms" / "pose.h5").write_bytes(b"pose")
    with_pose = content_digest(data)
    assert with_pose != before
    (data / "transforms" / "pose.h5").write_bytes(b"other")
    assert content_digest(data) != with_pose


def test_a_folder_keeps_its_digest_wherever_it_lies_and_links_are_followed(data: Path) -> None:
    before = content_digest(data)
    moved = data.rename(data.parent / "moved")
    assert content_digest(moved) == before
    (moved / "masks").rename(moved.parent / "elsewhere")
    (moved / "masks").symlink_to(moved.parent / "elsewhere")
    assert content_digest(moved) == before
    (moved.parent / "elsewhere" / "a.png").write_bytes(b"corrected")
    assert content_digest(moved) != before
    (moved / "loop").symlink_to(moved)  # ends all the same, and adds nothing
    (moved.parent / "elsewhere" / "a.png").write_bytes(b"masks a")
    assert content_digest(moved) == before


def test_results_inside_what_is_read_are_no_input(data: Path) -> None:
    before = content_digest(data)
    (data / "result").mkdir()
    (data / "result" / "metrics.json").write_text("{}")
    assert content_digest(data) != before
    assert content_digest(data, [data / "result"]) == before


def test_a_file_brings_along_the_pixels_that_its_header_names(home: Path) -> None:
    header, pixels = home / "ct.mhd", home / "ct.zraw"
    header.write_text("NDims = 3\nElementDataFile = ct.zraw\n")
    pixels.write_bytes(b"one")
    first = content_digest(header)
    pixels.write_bytes(b"two")
    assert content_digest(header) != first
    nhdr = home / "map.nhdr"
    nhdr.write_text("NRRD0004\ndata file: slice%02d.raw 1 2 1\n")
    (home / "slice01.raw").write_bytes(b"one")
    first = content_digest(nhdr)
    (home / "slice01.raw").write_bytes(b"two")
    assert content_digest(nhdr) != first
    whole = home / "whole.mha"
    whole.write_bytes(b"NDims = 3\nElementDataFile = LOCAL\n\x00\x01")
    first = content_digest(whole)
    pixels.write_bytes(b"three")
    assert content_digest(whole) == first


def test_a_file_of_a_bag_stands_for_the_bag(home: Path) -> None:
    bag = home / "bag"
    bag.mkdir()
    for name in ("metadata.yaml", "calibration.yaml", "bag_0.db3"):
        (bag / name).write_text(name)
    first = content_digest(bag / "bag_0.db3")
    (bag / "calibration.yaml").write_text("other")
    assert content_digest(bag / "bag_0.db3") != first


def test_nothing_there_and_nothing_inside_are_told_apart(home: Path) -> None:
    (home / "empty").mkdir()
    (home / "file").write_bytes(b"")
    assert content_digest(home / "nowhere") == ABSENT
    assert len({content_digest(home / name) for name in ("nowhere", "empty", "file")}) == 3


def test_what_can_not_be_read_is_refused_by_name(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from experiments import files

    def refuse(path: Path) -> str:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(files, "digest", refuse)
    with pytest.raises(
        InputError, match=r"data: expected files that can be read, found .*\.(png|csv): Permission"
    ):
        content_digest(data)
