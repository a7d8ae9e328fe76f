"""``ctus demo``: the whole path on simulated data, from training to a registration that is tried from many starts."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from experiments import files
from experiments.analysis.pages.demo import closing
from experiments.command_line.call_checks import require_writable
from experiments.errors import InputError
from experiments.paths import project_root
from experiments.running.terminal import markdown, print_tables

USAGE = """\
ctus demo [folder]

The whole path on simulated data, in about six minutes on two cores: train a U-Net, segment a sweep that it has not
seen, register the cloud to the phantom's model, once and from many wrong starts. Results go to outputs/demo, or to the
folder that is named.
"""


def steps(folder: Path) -> Iterator[tuple[str, str, list[str]]]:
    """Name each step of the demonstration.

    Parameters
    ----------
    folder : Path
        Folder of the results.

    Yields
    ------
    name : str
        The step's folder and log.
    sentence : str
        What it does.
    words : list of str
        The words of its call.
    """
    yield (
        "segmentation",
        "Training a U-Net on simulated frames, fold by fold",
        ["study=segmentation", "dataset=phantom", "dataset.sweeps=3", "dataset.frames_per_sweep=20", "trainer=demo"],
    )  # fmt: skip
    yield (
        "pipeline",
        "Segmenting a sweep that no network has seen, and placing its contours in the world",
        [
            "study=pipeline",
            "phantom=artery",
            _setting("model_path", folder / "segmentation" / "fold-0" / "model.pt"),
        ],
    )
    swept = folder / "pipeline"
    yield (
        "robustness",
        "Registering that cloud to the phantom's model, single start against multi-start",
        [
            *(
                "-m",
                "study=robustness",
                "overlaps=[1.0]",
                "trials=10",
                "perturbation.angle_max_deg=45,90,180",
            ),
            *(_setting("target", swept / "model.ply"), _setting("moving", swept / "cloud.ply")),
            _setting("moving_truth", swept / "truth.json"),
        ],
    )


def demo(words: Sequence[str]) -> int:
    """Run the demonstration, print two small tables and three sentences, and name the page to open.

    Parameters
    ----------
    words : sequence of str
        Words after ``demo``: none, or the folder of the results.

    Returns
    -------
    int
        Exit code: 0 when all is well, else that of the step that failed.

    Raises
    ------
    InputError
        For more than a folder, and one that can't be written.
    """
    if any(word in ("--help", "-h") for word in words):
        print(USAGE, end="")
        return 0
    if len(words) > 1 or any("=" in word or word.startswith("-") for word in words):
        raise InputError(f"demo: expected no more than a folder, received {' '.join(words)}")
    folder = _named(words[0]) if words else _shown(project_root() / "outputs" / "demo")
    if "${" in str(folder) or "\n" in str(folder):
        raise InputError(
            f"demo: expected a folder without ${{ and line ends in its name, received {str(folder)!r}"
        )
    require_writable(folder.absolute())
    folder.mkdir(parents=True, exist_ok=True)
    plan = list(steps(folder))
    for number, (name, sentence, call) in enumerate(plan, start=1):
        print(f"{number}/{len(plan)}  {sentence}", flush=True)
        code = _run([*call, _setting("out", folder / name)], folder / f"{name}.txt")
        if code:
            return code
    _close(folder, [name for name, _, _ in plan])
    return 0


def _run(words: list[str], log: Path) -> int:
    """A call in a process of its own: its progress goes to the terminal, its closing lines are kept."""
    program = "import sys; from experiments.cli import main; sys.exit(main())"
    with log.open("w", encoding="utf-8") as kept:
        call = subprocess.Popen([sys.executable, "-c", program, *words], stdout=kept)
        while True:
            try:
                code = call.wait()
                break
            except KeyboardInterrupt:  # the call was told to stop as well, and says what becomes of its runs
                continue
    if code:
        print(log.read_text(encoding="utf-8"), end="")
    return code


def _close(folder: Path, names: Sequence[str]) -> None:
    tables, sentences = closing(folder)
    print()
    print_tables(tables)
    for sentence in sentences:
        print(sentence)
    logs = [(folder / f"{name}.txt").read_text(encoding="utf-8") for name in names]
    head = f"# Demonstration, simulated data\n\n{markdown(tables)}\n" + "\n".join(
        f"- {each}" for each in sentences
    )
    everything = "\n\n".join(logs)
    files.write_text(
        folder / "summary.md", f"{head}\n\n## What the steps printed\n\n```\n{everything}\n```\n"
    )
    print(f"All numbers are of simulated data; {folder / 'summary.md'} has all of them.")
    print(f"Open:      {folder / 'pipeline' / 'scene.html'}")
    print(*[line for line in logs[-1].splitlines() if line.startswith("Dashboard: ")], sep="\n")


def _setting(name: str, path: Path) -> str:
    """A word of the call, quoted: a folder may be called anything."""
    escaped = str(path).replace("'", "\\'")
    return f"{name}='{escaped}'"


def _named(word: str) -> Path:
    if not word:
        raise InputError("demo: expected a folder, received an empty name")
    try:
        return Path(word).expanduser()
    except RuntimeError as failure:
        raise InputError(f"demo: expected a folder, received {word!r}: {failure}") from failure


def _shown(folder: Path) -> Path:
    """A folder from the current one on, where it lies in that."""
    here = Path.cwd()
    return folder.relative_to(here) if folder.is_relative_to(here) else folder
