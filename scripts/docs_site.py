"""What the documentation's site has beyond docs/: README, changelog, results, and the settings of every study.

MkDocs calls these functions while it builds the site (``hooks`` in mkdocs.yml). Pages link to files as they lie in the
repository, so that they work there too; the links are rewritten to where the site has these files.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
# Files of the repository that are pages, or files, of the site.
MOVED = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "CITATION.cff": "CITATION.cff",
    "LICENSE": "LICENSE",
}
SETTINGS = "reference/settings.md"
# The end of a link or picture, its target apart from a title.
_LINK = re.compile(r"\]\((?P<target>[^)\s]+)(?P<rest>[^)]*)\)")


def on_files(files: Any, config: Any) -> Any:
    """Add what lies outside docs/, and the page of all settings.

    Parameters
    ----------
    files : mkdocs.structure.files.Files
        Files of the site.
    config : mkdocs.config.defaults.MkDocsConfig
        Its configuration.

    Returns
    -------
    mkdocs.structure.files.Files
        The same, with more files.
    """
    from mkdocs.structure.files import File

    for place, source in outside().items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / source)))
    files.append(File.generated(config, SETTINGS, content=settings_page()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Rewrite the links of a page.

    Parameters
    ----------
    markdown : str
        Text of the page.
    page : mkdocs.structure.pages.Page
        The page.
    config, files : object
        Not used.

    Returns
    -------
    str
        The text with links to places of the site.
    """
    del config, files
    return with_site_links(markdown, page.file.src_uri)


def outside() -> dict[str, str]:
    """The files outside docs/ that the site has.

    Returns
    -------
    dict of str to str
        Place within the site, and within the repository.
    """
    results = {
        f"results/{path.name}": f"results/{path.name}"
        for path in (ROOT / "results").iterdir()
        if path.suffix in (".md", ".csv", ".png")
    }
    return {place: source for source, place in MOVED.items()} | results


def with_site_links(markdown: str, place: str) -> str:
    """Replace links between files of the repository by links between places of the site.

    Parameters
    ----------
    markdown : str
        Text of a page.
    place : str
        Place of the page within the site.

    Returns
    -------
    str
        The text; links to other servers, to anchors of the page and to files that the site lacks are left as they are.
    """
    source = outside().get(place, f"docs/{place}")

    def rewritten(match: re.Match[str]) -> str:
        target, _, anchor = match["target"].partition("#")
        if not target or "://" in target or target.startswith(("mailto:", "/")):
            return match[0]
        found = site_place(posixpath.normpath(posixpath.join(posixpath.dirname(source), target)))
        if found is None:
            return match[0]
        link = posixpath.relpath(found, posixpath.dirname(place) or ".")
        return f"]({link}{'#' + anchor if anchor else ''}{match['rest']})"

    return _LINK.sub(rewritten, markdown)


def site_place(path: str) -> str | None:
    """Where the site has a file of the repository.

    Parameters
    ----------
    path : str
        Path within the repository.

    Returns
    -------
    str or None
        Place within the site; None if it does not have it.
    """
    if path in MOVED:
        return MOVED[path]
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    return path if path in outside() else None


def settings_page() -> str:
    """Write the settings of every study and of its options, as ``ctus study=<name> --help`` shows them.

    Returns
    -------
    str
        The page.
    """
    from experiments.command_line.help_page import help_text
    from experiments.plugins import options_of

    parts = [
        "# Settings of every study\n\nAs `ctus study=<name> --help` shows them, with the options chosen by default."
    ]
    for study in sorted(options_of("study")):
        text = help_text([f"study={study}"]).split("\n\nSettings of every study\n")[0]
        parts.append(f"## {study}\n\n```yaml\n{text.partition(chr(10))[2].strip()}\n```")
    return "\n\n".join(parts) + "\n"
