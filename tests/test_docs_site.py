"""The documentation's site: every page is in its navigation, every link leads somewhere, here and there."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

import docs_site
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))
PAGES += [source for source in docs_site.outside().values() if source.endswith(".md")]
LINK = re.compile(r"\]\(([^)\s]+)[^)]*\)")


def links(text: str) -> list[str]:
    """Targets of the links and pictures of a page that lie in the repository; those in code are none."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"`[^`\n]*`", "", text)
    return [each for each in LINK.findall(text) if "://" not in each and not each.startswith("mailto:")]


def anchors(path: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub and MkDocs make them."""
    heads = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


def navigation() -> set[str]:
    """Every page that the navigation names."""
    # The file has no tags of Python's, which a site of this kind may have.
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    found, left = set(), [nav]
    while left:
        node = left.pop()
        if isinstance(node, str):
            found.add(node)
        else:
            left += node.values() if isinstance(node, dict) else node
    return found


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_to_a_file_and_a_heading(page: str) -> None:
    place = docs_site.site_place(page)
    assert place is not None
    for target in links((ROOT / page).read_text(encoding="utf-8")):
        path, _, anchor = target.partition("#")
        file = (
            ROOT / posixpath.normpath(posixpath.join(posixpath.dirname(page), path)) if path else ROOT / page
        )
        assert file.is_file(), f"{page}: {target}"
        assert docs_site.site_place(file.relative_to(ROOT).as_posix()) is not None, (
            f"{page}: {target}: not in the site"
        )
        assert not anchor or anchor in anchors(file), f"{page}: {target}: no such heading"


def test_the_navigation_has_every_page_once() -> None:
    expected = {docs_site.site_place(page) for page in PAGES} | {docs_site.SETTINGS}
    assert navigation() == expected


@pytest.mark.parametrize(
    ("place", "link", "rewritten"),
    [
        ("index.md", "docs/tutorials/index.md", "tutorials/index.md"),
        ("index.md", "CONTRIBUTING.md#a-study", "contributing.md#a-study"),
        ("tutorials/adding.md", "../../CONTRIBUTING.md", "../contributing.md"),
        ("explanation/hd95.md", "../../results/accuracy.md", "../results/accuracy.md"),
        ("results/accuracy.md", "accuracy.png", "accuracy.png"),
        ("runs.md", "https://example.org/docs/x.md", "https://example.org/docs/x.md"),
        ("runs.md", "#a-heading", "#a-heading"),
        ("runs.md", "../src/models/train.py", "../src/models/train.py"),
    ],
)
def test_links_are_rewritten_to_places_of_the_site(place: str, link: str, rewritten: str) -> None:
    assert docs_site.with_site_links(f"a [b]({link}) c", place) == f"a [b]({rewritten}) c"


def test_the_page_of_settings_has_every_study_and_its_comments() -> None:
    page = docs_site.settings_page()
    for path in (ROOT / "conf" / "study").glob("*.yaml"):
        assert f"\n## {path.stem}\n" in page
    assert "moving: ???             # file that moves" in page
    assert "tracking.uri=" not in page, "what all studies share stands in commands.md"


def test_every_documented_name_of_the_reference_is_there() -> None:
    for path in (ROOT / "docs" / "reference").glob("*.md"):
        for name in re.findall(r"^::: (\S+)$", path.read_text(encoding="utf-8"), re.MULTILINE):
            module, _, last = name.rpartition(".")
            file = ROOT / "src" / f"{name.replace('.', '/')}.py"
            if not file.is_file():
                file = ROOT / "src" / f"{module.replace('.', '/')}.py"
                assert re.search(rf"^(class|def) {last}\b", file.read_text(encoding="utf-8"), re.MULTILINE), (
                    name
                )
