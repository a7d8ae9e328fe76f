"""What a checklist is: numbered items in our own words, what is filled in, and how it reads as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from experiments.studies.checklist.facts import Facts

FILLED, IN_PART, MISSING = "filled", "in part", "missing"


@dataclass(frozen=True)
class Filling:
    """What runs tell of an item.

    Parameters
    ----------
    told : tuple of str
        Sentences; empty if they tell nothing.
    left : str, optional
        What the item asks for that no run tells; empty if it is complete.
    """

    told: tuple[str, ...] = ()
    left: str = ""


@dataclass(frozen=True)
class Item:
    """One item of a checklist.

    Parameters
    ----------
    number : str
        Its number in the source.
    section : str
        Part of a paper that it belongs to.
    asks : str
        What is to be reported, in our own words.
    """

    number: str
    section: str
    asks: str


@dataclass(frozen=True)
class Checklist:
    """A checklist with what fills its items.

    Parameters
    ----------
    title : str
        Its name.
    source : str
        Where its items come from.
    items : tuple of Item
        The items in order.
    fillers : Mapping[str, Callable[[Facts], Filling]], optional
        What fills an item from the facts of the runs, by its number. An item without one can't be told by a run.
    """

    title: str
    source: str
    items: tuple[Item, ...]
    fillers: Mapping[str, Callable[[Facts], Filling]] = field(default_factory=dict)

    def filled(self, facts: Facts) -> list[tuple[Item, Filling]]:
        """Fill every item.

        Parameters
        ----------
        facts : Facts
            What the runs tell.

        Returns
        -------
        list of tuple[Item, Filling]
            Items with what is told of them.
        """
        nothing = Filling()
        return [
            (item, self.fillers[item.number](facts) if item.number in self.fillers else nothing)
            for item in self.items
        ]


def state(filling: Filling) -> str:
    """Say whether an item is filled, filled in part, or missing.

    Parameters
    ----------
    filling : Filling
        What is told of it.

    Returns
    -------
    str
        ``filled``, ``in part`` or ``missing``.
    """
    if not filling.told:
        return MISSING
    return IN_PART if filling.left else FILLED


def markdown(checklist: Checklist, filled: Sequence[tuple[Item, Filling]], facts: Facts) -> str:
    """Write a filled checklist as Markdown.

    Parameters
    ----------
    checklist : Checklist
        The checklist.
    filled : sequence of tuple[Item, Filling]
        Its items with what is told of them.
    facts : Facts
        What the runs tell.

    Returns
    -------
    str
        The runs, every item by section, and the items that an author still has to write.
    """
    lines = [f"# {checklist.title}", "", f"Items after {checklist.source}, in other words.", ""]
    lines += ["Filled from these runs:", ""]
    lines += [
        f"- `{family.run.run_id}`: {family.run.experiment}, {family.run.name}" for family in facts.families
    ]
    section = ""
    for item, filling in filled:
        if item.section != section:
            section = item.section
            lines += ["", f"## {section}"]
        lines += ["", f"**{item.number}. {item.asks}** ({state(filling)})", ""]
        lines += [f"- {text}" for text in filling.told]
        lines += [f"- Not told by a run: {filling.left}"] if filling.told and filling.left else []
        lines += [] if filling.told else ["- Not told by a run."]
    lines += ["", "## Still to be written", ""]
    for item, filling in filled:
        if state(filling) == IN_PART:
            lines.append(f"- {item.number}, in part: {filling.left}")
        elif state(filling) == MISSING:
            lines.append(f"- {item.number}: {item.asks}")
    return "\n".join(lines) + "\n"
