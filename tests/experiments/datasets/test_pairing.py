from pathlib import Path

import pytest

from experiments.datasets.pairing import Pairing, pair, require_choice
from experiments.errors import InputError

ROOT = Path("set")
IMAGES = {name: ROOT / "images" / f"{name}.png" for name in "abc"}
MASKS = {name: ROOT / "masks" / f"{name}.png" for name in "bcde"}


def test_all_that_has_no_partner_is_named_at_once() -> None:
    found = pair(IMAGES, MASKS, [ROOT / "images" / "model.h5"])
    assert dict(found.pairs) == {name: (IMAGES[name], MASKS[name]) for name in "bc"}
    with pytest.raises(InputError) as refusal:
        found.settled("refuse", ROOT, "; the last group is small")
    assert str(refusal.value) == (
        "set: expected a mask of the same name for every image and an image for every mask, found no mask for 1 image "
        "(images/a.png) and no image for 2 masks (masks/d.png, masks/e.png), with 1 file of another kind "
        "(images/model.h5); the last group is small; pass dataset.unpaired=skip to go on without them"
    )
    assert found.settled("skip", ROOT) is found and found.unpaired == 3
    assert found.notes(ROOT) == (
        "Left out as unpaired: 1 image without a mask and 2 masks without an image.",
        "Not used: 1 file of another kind (images/model.h5).",
    )


def test_files_of_another_kind_alone_are_no_reason_to_refuse() -> None:
    found = pair(IMAGES, IMAGES, [ROOT / "notes.txt"])
    assert found.settled("refuse", ROOT) is found and found.unpaired == 0


def test_parts_add_up_and_nothing_in_common_is_refused_either_way() -> None:
    whole = pair({"a": IMAGES["a"]}, {"a": MASKS["b"]}, prefix="s_") + Pairing({}, masks=(MASKS["c"],))
    assert list(whole.pairs) == ["s_a"] and whole.unpaired == 1
    with pytest.raises(
        InputError, match="expected images and masks of the same names, found no mask for 3 images"
    ):
        pair(IMAGES, {}).settled("skip", ROOT)
    with pytest.raises(InputError, match="unpaired: expected refuse or skip, received None"):
        require_choice(None)
