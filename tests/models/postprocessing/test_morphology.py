import numpy as np
import pytest
from scipy.ndimage import binary_fill_holes, gaussian_filter
from skimage.morphology import closing, disk, remove_small_objects

from models.errors import InputError
from models.postprocessing import Morphology


def drawn(*rows: str) -> np.ndarray:
    return np.array([[pixel == "#" for pixel in row] for row in rows])


def shown(mask: np.ndarray) -> list[str]:
    return ["".join(".#"[int(pixel)] for pixel in row) for row in mask]


def blobs(seed: int, size: int = 80) -> np.ndarray:
    return np.asarray(gaussian_filter(np.random.default_rng(seed).standard_normal((size, size)), 1.5) > 0.1)


def test_by_default_nothing_is_done_to_a_copy() -> None:
    mask = blobs(0)
    result = Morphology()(mask, None)
    np.testing.assert_array_equal(result, mask)
    assert result is not mask and not np.shares_memory(result, mask)


def test_closing_bridges_a_gap_by_hand() -> None:
    mask = drawn(
        ".......",
        ".##.##.",
        ".##.##.",
        ".##.##.",
        ".......",
    )
    # A disc of radius 1 is a cross of five pixels: in the middle row it does not fit into the gap.
    assert shown(Morphology(closing_radius_px=1.0)(mask, None)) == [
        ".......",
        ".##.##.",
        ".#####.",
        ".##.##.",
        ".......",
    ]


@pytest.mark.parametrize("radius", [1, 2, 3, 5])
def test_closing_equals_scikit_image_away_from_the_border(radius: int) -> None:
    mask = np.pad(blobs(1), 12)
    np.testing.assert_array_equal(
        Morphology(closing_radius_px=radius)(mask, None), closing(mask, disk(radius))
    )


@pytest.mark.parametrize("radius", [0.3, 0.55, 1.0, 2.5])
@pytest.mark.parametrize("spacing", [(0.1, 0.3), (0.3, 0.1), (0.25, 0.25)])
def test_closing_in_mm_equals_scikit_image_with_an_elliptic_element(
    radius: float, spacing: tuple[float, float]
) -> None:
    rows, columns = np.indices((61, 61)) - 30
    element = np.hypot(rows * spacing[0], columns * spacing[1]) <= radius + 1e-9
    mask = np.pad(blobs(1, size=50), 31)
    np.testing.assert_array_equal(Morphology(closing_radius_mm=radius)(mask, spacing), closing(mask, element))


def test_closing_keeps_what_is_there_and_adds_nothing_the_second_time() -> None:
    for seed in range(3):
        mask, recipe = blobs(seed), Morphology(closing_radius_px=2.5)
        once = recipe(mask, None)
        assert (once | ~mask).all() and once.sum() > mask.sum()
        np.testing.assert_array_equal(recipe(once, None), once)


def test_the_images_border_closes_nothing() -> None:
    # Discs that lie half beyond the border fit into the gap's ends, and none fits into its middle.
    edge = drawn("#.#", "#.#", "#.#")
    wide = drawn("#..#", "#..#", "#..#")
    assert shown(Morphology(closing_radius_px=2.0)(wide, None)) == ["#..#", "####", "#..#"]
    assert shown(Morphology(closing_radius_px=1.0)(edge, None)) == ["#.#", "###", "#.#"]


def test_a_radius_in_mm_follows_the_spacing() -> None:
    # Two columns apart: 0.4 mm; two rows apart: 2 mm.
    across, along = drawn("#.#"), drawn("#", ".", "#")
    recipe = Morphology(closing_radius_mm=0.25)
    assert shown(recipe(across, (1.0, 0.2))) == ["###"]
    assert shown(recipe(along, (1.0, 0.2))) == ["#", ".", "#"]
    assert shown(recipe(along, (0.2, 1.0))) == ["#", "#", "#"]


def test_a_hole_is_filled_and_a_bay_is_not() -> None:
    mask = drawn(
        "######..",
        "#..#.#..",
        "#..#.###",
        "####...#",
        "...#.#.#",
        "...#.###",
    )
    result = Morphology(fill_holes=True)(mask, None)
    assert shown(result) == [
        "######..",
        "####.#..",
        "####.###",
        "####...#",
        "...#.#.#",
        "...#.###",
    ]


def test_holes_are_parted_from_the_outside_by_the_other_connectivity() -> None:
    # A ring that hangs together over corners alone.
    ring = drawn("..#..", ".#.#.", "..#..")
    assert shown(Morphology(fill_holes=True, connectivity=1)(ring, None)) == shown(ring)
    assert Morphology(fill_holes=True, connectivity=2)(ring, None)[1, 2]


@pytest.mark.parametrize("seed", range(3))
def test_filling_equals_scipy_where_the_background_hangs_over_edges(seed: int) -> None:
    mask = blobs(seed)
    np.testing.assert_array_equal(
        Morphology(fill_holes=True, connectivity=2)(mask, None), binary_fill_holes(mask)
    )


@pytest.mark.parametrize("connectivity", [1, 2])
def test_removal_equals_scikit_image(connectivity: int) -> None:
    mask = blobs(2)
    for least in (2, 10, 40):
        expected = remove_small_objects(mask, max_size=least - 1, connectivity=connectivity)
        recipe = Morphology(min_area_px=least, connectivity=connectivity)
        np.testing.assert_array_equal(recipe(mask, None), expected)


def test_components_of_exactly_the_least_area_stay() -> None:
    mask = drawn("##..#", "##..#", ".....", "#....")
    assert shown(Morphology(min_area_px=2)(mask, None)) == ["##..#", "##..#", ".....", "....."]
    # Ten pixels of 0.1 by 0.1 are 0.1 mm^2, rounded or not.
    ten = drawn("#####", "#####")
    assert Morphology(min_area_mm2=0.1)(ten, (0.1, 0.1)).all()
    assert not Morphology(min_area_mm2=0.101)(ten, (0.1, 0.1)).any()


def test_pixels_count_where_no_spacing_is_known() -> None:
    mask = drawn("##..#", "##...")
    recipe = Morphology(min_area_mm2=3.0, min_area_px=4)
    assert shown(recipe(mask, None)) == ["##...", "##..."]
    assert shown(recipe(mask, (2.0, 2.0))) == shown(mask)
    assert shown(recipe(mask, (0.5, 0.5))) == [".....", "....."]
    assert shown(Morphology(min_area_px=4)(mask, (0.5, 0.5))) == ["##...", "##..."]


def test_the_largest_component_and_the_first_of_equal_ones() -> None:
    assert shown(Morphology(largest_only=True)(drawn("#.##", "#.##", "#..."), None)) == [
        "..##",
        "..##",
        "....",
    ]
    assert shown(Morphology(largest_only=True)(drawn(".#.#"), None)) == [".#.."]
    assert not Morphology(largest_only=True, min_area_px=3)(drawn("##.#"), None).any()


def test_the_order_is_closing_filling_removal() -> None:
    # The ring has a gap: closed, it encloses; filled, it is large enough.
    ring = drawn(
        ".......",
        ".#####.",
        ".#...#.",
        ".#.....",
        ".#...#.",
        ".#####.",
        ".......",
    )
    recipe = Morphology(closing_radius_px=1.5, fill_holes=True, min_area_px=25)
    assert recipe(ring, None).sum() == 25
    assert not Morphology(min_area_px=25)(ring, None).any()


def test_an_empty_and_a_full_mask() -> None:
    recipe = Morphology(closing_radius_px=3, fill_holes=True, min_area_px=5, largest_only=True)
    assert not recipe(np.zeros((6, 7), bool), None).any()
    assert recipe(np.ones((6, 7), bool), None).all()


def test_refuses_sizes_without_spacing_and_out_of_range() -> None:
    mask = drawn("##")
    with pytest.raises(InputError, match=r"spacing_mm: expected the size of a pixel for min_area_mm2=2\.0"):
        Morphology(min_area_mm2=2.0)(mask, None)
    with pytest.raises(
        InputError, match=r"for closing_radius_mm=1\.0, received none \(give closing_radius_px"
    ):
        Morphology(closing_radius_mm=1.0)(mask, None)
    with pytest.raises(InputError, match="spacing_mm: expected two positive"):
        Morphology()(mask, (0.0, 1.0))
    for name in ("closing_radius_px", "closing_radius_mm", "min_area_px", "min_area_mm2"):
        with pytest.raises(InputError, match=f"{name}: expected a number from 0"):
            Morphology(**{name: -1.0})
    with pytest.raises(InputError, match="connectivity"):
        Morphology(connectivity=4)
