"""The last lines of the demonstration: two small tables, three sentences and the page to open."""

from __future__ import annotations

import sys
from pathlib import Path

from experiments import files
from experiments.analysis.pages.demo import closing
from experiments.running.terminal import markdown, print_tables

STEPS = ("pipeline.txt", "segmentation.txt", "robustness.txt")


def main() -> None:
    """Print them, and leave them with everything that the steps printed in ``summary.md``."""
    folder = Path(sys.argv[1])
    tables, sentences = closing(folder)
    print_tables(tables)
    for sentence in sentences:
        print(sentence)
    everything = "\n\n".join((folder / name).read_text(encoding="utf-8") for name in STEPS)
    head = f"# Demonstration, simulated data\n\n{markdown(tables)}\n" + "\n".join(
        f"- {each}" for each in sentences
    )
    files.write_text(
        folder / "summary.md", f"{head}\n\n## What the steps printed\n\n```\n{everything}\n```\n"
    )


if __name__ == "__main__":
    main()
