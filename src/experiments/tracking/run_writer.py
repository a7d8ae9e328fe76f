"""A run that is being written: every call of it that reaches the tracker."""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.errors import InputError
from experiments.masking import masked
from experiments.outcome import InputData
from experiments.tracking.names import tracked_name
from experiments.tracking.retry_queue import Deferred
from experiments.tracking.written import RunStart, Written

if TYPE_CHECKING:
    from mlflow.tracking import MlflowClient

HEARTBEAT_S = 30.0
# The tracker takes no more of a digest.
DIGEST_LENGTH = 36
# How long a run that has ended waits for a server that does not answer, before it is kept as files.
LAST_WAIT_S = 20.0
# What one request may carry at most (MLflow's REST limits, which its SQL store keeps as well).
_METRICS_A_BATCH, _PARAMS_A_BATCH, _TAGS_A_BATCH, _PARAM_LENGTH, _TAG_LENGTH = 1000, 100, 100, 6000, 8000


class ServerAwayError(InputError):
    """The tracking server does not answer: what is computed meanwhile is kept for it."""


class RunWriter:
    """A run that is being written. A thread keeps its heartbeat until it ends.

    While a server does not answer, what is logged waits, and is sent when it answers again. ``lost`` says, after the
    end, that it never did; ``known`` is false for a run that the server has not even heard of, which then needs no
    ``client``. ``written`` has all that was logged, for a later delivery.
    """

    def __init__(
        self,
        client: MlflowClient | None,
        run_id: str,
        *,
        beating: bool = True,
        start: RunStart | None = None,
        known: bool = True,
    ) -> None:
        self.run_id = run_id
        self.start = start
        self.written = Written()
        self.lost = not known
        # What the tracker refused, by name: the run is not complete there, and is kept as files.
        self.refused: list[str] = []
        self._client = client
        self._deferred = Deferred(server_unreachable, _say)
        self._ended = threading.Event()
        if beating:
            threading.Thread(target=self._beat, daemon=True, name=f"heartbeat {run_id}").start()

    @property
    def incomplete(self) -> bool:
        """Whether the tracker lacks something of the run."""
        return self.lost or bool(self.refused)

    def _send(self, method: str, *given: Any, **named: Any) -> None:
        if not self.lost:
            self._deferred(partial(getattr(self._client, method), self.run_id, *given, **named))

    def params(self, params: Mapping[str, Any]) -> None:
        """Log flat parameters; a value too long for the tracker is cut (the resolved configuration holds it whole).

        Parameters
        ----------
        params : Mapping[str, Any]
            Parameters by name.
        """
        from mlflow.entities import Param

        shown = {tracked_name(key): masked(str(value))[:_PARAM_LENGTH] for key, value in params.items()}
        self.written.params.update(shown)
        entries = [Param(key, value) for key, value in shown.items()]
        for batch in _batches(entries, _PARAMS_A_BATCH):
            self._send("log_batch", params=batch)

    def metrics(self, metrics: Mapping[str, float], step: int = 0) -> None:
        """Log metrics of one step.

        Parameters
        ----------
        metrics : Mapping[str, float]
            Scalars by metric name.
        step : int, optional
            Step (epoch) of the values.
        """
        self.history([metrics], step)

    def history(self, steps: Iterable[Mapping[str, float]], first_step: int = 0) -> None:
        """Log metrics step by step in batches, as ``loggable`` says.

        Parameters
        ----------
        steps : Iterable[Mapping[str, float]]
            Metrics of each step.
        first_step : int, optional
            Number of the first of the steps.
        """
        now_ms = int(time.time() * 1000)
        self.points(
            (key, value, now_ms, step)
            for step, metrics in enumerate(steps, first_step)
            for key, value in loggable(metrics).items()
        )

    def points(self, points: Iterable[tuple[str, float, int, int]]) -> None:
        """Log metric points (name, finite value, time in ms, step) in batches, as ``tracked_name`` calls them.

        Parameters
        ----------
        points : Iterable[tuple[str, float, int, int]]
            Name, finite value, time in ms and step of each point.
        """
        from mlflow.entities import Metric

        named = [(tracked_name(name), value, time_ms, step) for name, value, time_ms, step in points]
        self.written.points += named
        entries = [Metric(*point) for point in named]
        for batch in _batches(entries, _METRICS_A_BATCH):
            self._send("log_batch", metrics=batch)

    def tags(self, tags: Mapping[str, str]) -> None:
        """Set tags.

        Parameters
        ----------
        tags : Mapping[str, str]
            Tags by name.
        """
        from mlflow.entities import RunTag

        self.written.tags.update(shortened(tags))
        entries = [RunTag(key, value) for key, value in shortened(tags).items()]
        for batch in _batches(entries, _TAGS_A_BATCH):
            self._send("log_batch", tags=batch)

    def drop_tags(self, names: Iterable[str]) -> None:
        """Remove tags.

        Parameters
        ----------
        names : Iterable[str]
            Names of tags.
        """
        for name in names:
            self._send("delete_tag", name)

    def inputs(self, data: Iterable[InputData]) -> None:
        """Record the data sets the run used.

        Parameters
        ----------
        data : Iterable[InputData]
            Data sets that were used.
        """
        from mlflow.entities import Dataset, DatasetInput

        shown = [InputData(each.name, each.digest[:DIGEST_LENGTH], masked(each.source)) for each in data]
        self.written.inputs += shown
        entries = [
            DatasetInput(
                Dataset(item.name, item.digest, "local", json.dumps({"uri": item.source})),
                tags=[],
            )
            for item in shown
        ]
        if entries:
            self._send("log_inputs", datasets=entries)

    def text(self, text: str, name: str) -> None:
        """Store ``text`` as an artifact.

        Parameters
        ----------
        text : str
            Content.
        name : str
            Name of the artifact.
        """
        self.written.texts[name] = masked(text)
        self._send("log_text", masked(text), name)

    def files(self, folder: Path, names: Iterable[str]) -> None:
        """Store the files ``names`` (paths from ``folder`` on) as artifacts under these names.

        They may be moved afterwards, so this can't wait.

        Parameters
        ----------
        folder : Path
            Folder that holds the files.
        names : Iterable[str]
            Names of the files, from that folder on.
        """
        names = tuple(names)
        self.written.add_files(folder, names)
        for name in names:
            inside = Path(name).parent.as_posix()
            place = None if inside == "." else inside
            self._send("log_artifact", str(folder / name), place)
            if self._deferred.waiting:
                self._give_up()

    def end(self, status: str, end_ms: int | None = None) -> None:
        """Set how the run ended, FINISHED, FAILED or KILLED, and when (now by default).

        A tracker that refuses this is no failure of what was computed: it is reported, and the run counts as failed at
        the next call. A run of which the tracker refused anything is not complete there and ends as FAILED, until it is
        delivered.

        Parameters
        ----------
        status : str
            FINISHED, FAILED or KILLED.
        end_ms : int or None, optional
            End in ms since 1970; None for now.
        """
        self._ended.set()
        self.written.status = status
        self.written.end_ms = int(time.time() * 1000) if end_ms is None else end_ms
        if self.refused and status == "FINISHED":
            status = "FAILED"
        try:
            self._send("set_terminated", status, end_ms)
        except Exception as refusal:
            self.refused.append("its end")
            _say(f"The tracker refused to end run {self.run_id} as {status}: {refusal}")
        self._give_up()

    def withdraw(self) -> None:
        """Remove the run, which has computed nothing, from the dashboard."""
        self._ended.set()
        try:
            self._send("set_terminated", "FAILED")
            self._send("delete_run")
        except Exception as refusal:
            _say(f"The tracker refused to remove run {self.run_id}: {refusal}")
        self._give_up()

    def _give_up(self) -> None:
        """Take the run for lost unless the server answers within the last wait."""
        while not self.lost:
            try:
                self.lost = not self._deferred.last(LAST_WAIT_S)
                return
            except Exception as refusal:  # that call is gone; those after it are still to be made
                self.refused.append("what had waited")
                _say(f"The tracker refused what had waited of run {self.run_id}: {refusal}")

    def _beat(self) -> None:
        while not self._ended.wait(HEARTBEAT_S):
            try:
                assert self._client is not None, "only a run that the tracker knows beats"
                self._client.set_tag(self.run_id, "ctus.heartbeat", f"{time.time():.0f}")
            except Exception:  # a store that is busy or away for a moment must not end the heartbeat
                continue


@contextmanager
def ending(run: RunWriter, refusals: tuple[type[Exception], ...] = ()) -> Iterator[RunWriter]:
    """End the run as FINISHED, or as FAILED when the block raises anything, a stop by signal included.

    What the user got wrong is no run: where the block raises one of ``refusals``, the run is withdrawn.

    Parameters
    ----------
    run : RunWriter
        The run that is being written.
    refusals : tuple of type, optional
        Exceptions that mean that the user's input is at fault.

    Returns
    -------
    Iterator[RunWriter]
        The same run.
    """
    try:
        yield run
    except refusals:
        run.withdraw()
        raise
    except BaseException as failure:
        with suppress(Exception):  # the failure itself is what counts
            run.tags({"ctus.error": f"{type(failure).__name__}: {failure}"})
        run.end("FAILED")
        raise
    run.end("FINISHED")


def loggable(metrics: Mapping[str, float]) -> dict[str, float]:
    """Metrics as the tracker may have them: one that is not finite becomes ``<metric>_failed = 1``.

    The tracker can't tell NaN from a missing value and stores infinity as 1.8e308.

    Parameters
    ----------
    metrics : Mapping[str, float]
        Scalars by metric name.

    Returns
    -------
    dict[str, float]
        Finite values by name.
    """
    return {
        key if math.isfinite(value) else f"{key}_failed": value if math.isfinite(value) else 1.0
        for key, value in metrics.items()
    }


def server_unreachable(error: Exception) -> bool:
    """Whether an exception means that a tracking server did not answer, or that it is not able to just now.

    Parameters
    ----------
    error : Exception
        Exception of a call.

    Returns
    -------
    bool
        Whether an exception means that a tracking server did not answer, or that it is not able to just now.
    """
    from mlflow.exceptions import MlflowException
    from requests.exceptions import ConnectionError, Timeout

    if isinstance(error, (ConnectionError, Timeout, ServerAwayError)):
        return True
    # MLflow has no class of its own for this, only its words.
    signs = (
        "failed with exception",
        "failed with timeout exception",
        *(f"error code {c}" for c in (502, 503, 504)),
    )
    return isinstance(error, MlflowException) and any(sign in str(error) for sign in signs)


def _say(sentence: str) -> None:
    print(masked(sentence.splitlines()[0]), file=sys.stderr)


def shortened(tags: Mapping[str, str]) -> dict[str, str]:
    """Tags no longer than the tracker takes them, without passwords.

    Parameters
    ----------
    tags : Mapping[str, str]
        Tags by name.

    Returns
    -------
    dict[str, str]
        The tags.
    """
    return {key: masked(value)[:_TAG_LENGTH] for key, value in tags.items()}


def _batches(entries: list[Any], size: int) -> Iterator[list[Any]]:
    for start in range(0, len(entries), size):
        yield entries[start : start + size]
