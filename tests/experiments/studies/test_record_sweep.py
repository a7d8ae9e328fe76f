"""A recording becomes a plain folder that can be read again."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import numpy as np
import pytest
from sweeps import known_sweep, world_T_ee

from experiments.outcome import Silent
from experiments.studies import record_sweep
from registration.readers.folder import FolderReader
from registration.readers.live import LiveRecorder
from registration.readers.plus.calibration_file import calibration_yaml

pyigtl = pytest.importorskip("pyigtl")


def test_stream_becomes_a_folder(tmp_path: Path) -> None:
    (tmp_path / "probe.yaml").write_text(calibration_yaml(known_sweep().calibration))
    pixels = np.random.default_rng(0).integers(0, 256, (5, 1, 6, 9)).astype(np.uint8)
    data = b"".join(
        pyigtl.TransformMessage(
            world_T_ee(np.array([0.1 * i]))[0], timestamp=50 + 0.1 * i, device_name="EE"
        ).pack()
        + pyigtl.ImageMessage(pixels[i], timestamp=50.01 + 0.1 * i, device_name="US").pack()
        for i in range(5)
    )
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(5)

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.sendall(data)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        port = listener.getsockname()[1]
        live = LiveRecorder("US", "EE", str(tmp_path / "probe.yaml"), port=port, give_up_s=0.5)
        outcome = record_sweep.run(live=live, duration_s=2.0, workspace=tmp_path, progress=Silent())
        thread.join(timeout=5)
    found = FolderReader()(tmp_path / "sweep")
    np.testing.assert_array_equal(found.images, pixels[:, 0])
    np.testing.assert_allclose(found.pose_times_s, 50 + 0.1 * np.arange(5), atol=1e-6)
    assert outcome.metrics["frames"] == 5.0
