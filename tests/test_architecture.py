"""The picture in docs/architecture.md, held against the code: who may import whom, and how full a folder may be."""

from __future__ import annotations

import subprocess
from collections import Counter
from pathlib import Path

import pytest
import structure

REPOSITORY = Path(__file__).resolve().parents[1]
SRC = REPOSITORY / "src"
MODULES = structure.read_modules(SRC)
GRAPH = structure.import_graph(MODULES)
FORBIDDEN = {
    # It hands on the others, and may cost nothing to import.
    "ctus": {
        "models",
        "registration",
        "experiments",
        "numpy",
        "torch",
        "open3d",
        "mlflow",
        "hydra",
        "pandas",
    },
    "models": {"registration", "experiments", "open3d", "mlflow", "hydra", "omegaconf", "pandas"},
    "registration": {
        "models",
        "experiments",
        "lightning",
        "monai",
        "mlflow",
        "hydra",
        "omegaconf",
        "torch",
        "pandas",
    },
    "experiments": set(),
}
# A library and the only modules that may import it.
KEPT_IN = {
    "mlflow": {
        "experiments.tracking.store",
        "experiments.tracking.run_writer",
        "experiments.tracking.model_registry",
        "experiments.tracking.served_model",
    },
    "hydra": {"experiments.cli"},
    "omegaconf": {"experiments.cli", "experiments.command_line.method_settings"},
}
# Lowest first. A module imports from its own entry and from lower layers; never from another entry of its layer, for
# which reason the lowest layer, the ground, is one entry. The longest prefix decides.
LAYERS: dict[str, list[list[str]]] = {
    "ctus": [["ctus"]],
    "models": [
        ["models"],
        [
            "models.networks",
            "models.preprocessing",
            "models.metrics",
            "models.calibration",
            "models.postprocessing",
        ],
        ["models.weights_file"],
        ["models.checkpoint"],
        ["models.model_file"],
        ["models.export"],
        ["models.inference"],
        ["models.predictor"],
        ["models.averaging"],
        ["models.training", "models.evaluation"],
        ["models.train"],
    ],
    "registration": [
        ["registration"],
        ["registration.geometry"],
        ["registration.metrics"],
        [
            "registration.rigid.icp",
            "registration.calibration",
            "registration.reconstruction",
        ],
        ["registration.rigid.residual_model"],
        ["registration.io", "registration.centerline", "registration.rigid"],
        [
            "registration.rigid.comparators",
            "registration.ct_model",
            "registration.pipeline",
            "registration.perturbation",
            "registration.readers",
            "registration.deformable",
        ],
        ["registration.cpd"],
        ["registration.phantom"],
        ["registration.benchmark"],
    ],
    "experiments": [
        ["experiments"],
        ["experiments.statistics", "experiments.registry"],
        [
            "experiments.tracking",
            "experiments.splits",
            "experiments.inputs",
            "experiments.reporting",
            "experiments.validation",
        ],
        ["experiments.datasets", "experiments.running"],
        ["experiments.analysis"],
        ["experiments.studies"],
        ["experiments.command_line"],
        ["experiments.cli"],
    ],
}
# A module this short is joined to its user, unless it is the ground under many others.
SHORTEST = 40
SHORT = {"models.array_types", "models.atomic", "models.seeds", "experiments.paths", "registration.checks"}
MAX_MODULES = 25
# Bodies that are longer than the others may be. The list only shrinks.
LONG_BODIES: set[str] = set()


def entry_of(module: str) -> tuple[int, str]:
    """The layer of a module and the entry of the table that names it."""
    entries = [(layer, name) for layer, names in enumerate(LAYERS[module.split(".")[0]]) for name in names]
    return max(
        (entry for entry in entries if module == entry[1] or module.startswith(f"{entry[1]}.")),
        key=lambda entry: len(entry[1]),
    )


def is_door(module: str) -> bool:
    """Whether a module is the ``__init__`` of a package."""
    return MODULES[module].path.stem == "__init__"


@pytest.mark.parametrize("module", MODULES)
def test_no_forbidden_library(module: str) -> None:
    used = {name.split(".")[0] for name in structure.imported_names(MODULES[module], MODULES)}
    assert not used & FORBIDDEN[module.split(".")[0]]
    for library, allowed in KEPT_IN.items():
        assert library not in used or module in allowed


def test_no_circle_of_modules() -> None:
    assert structure.circles(GRAPH) == []


def test_no_circle_of_folders() -> None:
    assert structure.circles(structure.package_graph(MODULES, GRAPH)) == []


@pytest.mark.parametrize("module", MODULES)
def test_a_module_imports_only_from_lower_layers(module: str) -> None:
    top = module.split(".")[0]
    layer, entry = entry_of(module)
    above = [
        other
        for other in sorted(GRAPH[module])
        if other.split(".")[0] == top and entry_of(other)[1] != entry and entry_of(other)[0] >= layer
    ]
    assert above == [], f"{module} ({entry}, layer {layer}) imports {', '.join(above)}"


def test_no_study_imports_another_study() -> None:
    assert structure.study_imports(GRAPH) == []


@pytest.mark.parametrize("package", ["registration.rigid", "registration.centerline"])
def test_methods_read_no_files(package: str) -> None:
    found = [
        (name, other)
        for name in MODULES
        if name == package or name.startswith(f"{package}.")
        for other in GRAPH[name]
        if other.startswith("registration.io")
    ]
    assert found == []


def test_no_folder_is_too_full() -> None:
    count = Counter(module.package for name, module in MODULES.items() if not is_door(name))
    assert {package: number for package, number in count.items() if number > MAX_MODULES} == {}


def test_no_four_modules_of_a_folder_share_a_prefix() -> None:
    families = Counter(
        (module.package, name.rpartition(".")[2].split("_")[0])
        for name, module in MODULES.items()
        if not is_door(name)
    )
    assert {family: number for family, number in families.items() if number > 3} == {}


def test_no_module_is_a_crumb() -> None:
    crumbs = {
        name: module.lines
        for name, module in MODULES.items()
        if module.lines < SHORTEST and not is_door(name)
    }
    assert {
        name: lines for name, lines in crumbs.items() if name not in SHORT and not name.endswith(".errors")
    } == {}


def test_no_function_body_is_long() -> None:
    long = {
        name: lines for lines, name in structure.function_bodies(MODULES) if lines > structure.LONGEST_BODY
    }
    assert {name: lines for name, lines in long.items() if name not in LONG_BODIES} == {}


def test_every_test_file_stands_where_its_module_does() -> None:
    tests = REPOSITORY / "tests"
    for path in tests.rglob("test_*.py"):
        if path.parent != tests:
            assert (SRC / path.relative_to(tests).parent).is_dir(), path


def test_there_is_no_module_called_utils() -> None:
    assert not [name for name in MODULES if name.split(".")[-1] in ("utils", "helpers", "misc")]


def test_the_packages_are_the_three_and_the_name_over_them() -> None:
    assert {path.parent.name for path in SRC.glob("*/__init__.py")} == set(structure.PACKAGES)


def test_the_top_of_the_checkout_holds_what_belongs_there() -> None:
    """A run or a test that wrote into the current folder would be committed with the next change otherwise."""
    listed = subprocess.run(
        ["git", "-C", str(REPOSITORY), "ls-files"], capture_output=True, text=True, check=True
    ).stdout
    folders = {path.split("/")[0] for path in listed.splitlines() if "/" in path}
    assert folders == {".ci", "conf", "docs", "results", "scripts", "src", "tests"}


def test_the_picture_names_every_module_in_its_room() -> None:
    text = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
    drawn = text.split("<!-- rooms -->")[1].split("```")[1]
    rooms: dict[str, set[str]] = {}
    trail: list[str] = []
    for line in filter(None, drawn.splitlines()):
        place, rest = line[:29].strip(), line[29:].strip()
        if place:
            depth = (len(line) - len(line.lstrip())) // 2
            trail = [*trail[:depth], place.removeprefix("src/").strip("/").replace("/", ".")]
        rooms.setdefault(".".join(trail), set()).update(rest.split("   ")[0].split())
    expected: dict[str, set[str]] = {}
    for name, module in MODULES.items():
        if not is_door(name):
            expected.setdefault(module.package, set()).add(name.rpartition(".")[2])
    assert rooms == expected
