"""A tracking server on this machine: MLflow on the loopback, with PostgreSQL and a folder for artifacts.

    python scripts/server.py [--folder .server] [--port 5000] [--database-port 0] [--no-auth]
    python scripts/server.py --down

PostgreSQL (Debian: apt-get install postgresql) runs a cluster of its own in the folder, as the user ``postgres`` where
root calls this. Passwords are drawn at the first start and lie in the folder, readable by their owner alone. Ctrl-C, or
``--down`` from elsewhere, ends both. ``make server`` and ``make server-down`` call this.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

USER = "ctus"
HOST = "127.0.0.1"
STARTS_S, ENDS_S = 180.0, 30.0
AUTH = """[mlflow]
default_permission = NO_PERMISSIONS
database_uri = {address}
admin_username = {user}
admin_password = {password}
authorization_function = mlflow.server.auth:authenticate_request_basic_auth
# A checked password counts for a minute: its hash would cost each request a tenth of a second.
auth_cache_ttl_seconds = 60
"""


class Postgres:
    """A cluster of databases in a folder, for this user alone, on the loopback."""

    def __init__(self, folder: Path, port: int) -> None:
        self.folder = folder
        self.data = folder / "data"
        self.port = port or free_port()
        # PostgreSQL refuses to run as root.
        self.user = "postgres" if os.geteuid() == 0 else None

    def start(self, password: str) -> None:
        """Make the cluster if there is none, and start it."""
        if not (self.data / "PG_VERSION").exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            self._require_reach()
            given = self.folder / "password"
            write_secret(given, password)
            for path in (self.folder, given):
                if self.user:
                    shutil.chown(path, self.user)
            words = ["-D", self.data, "-U", USER, "--pwfile", given, "--auth", "scram-sha-256", "-E", "UTF8"]
            self._call("initdb", *words, "--no-locale", "--no-instructions")
            given.unlink()
        options = f"-p {self.port} -c listen_addresses={HOST} -c unix_socket_directories="
        self.stop()
        log = self.folder / "postgres.log"
        self._call(
            "pg_ctl", "-D", self.data, "-w", "-l", log, "-o", f"{options} -c max_connections=200", "start"
        )

    def stop(self) -> None:
        """End it if it runs, without waiting for its users; what was committed is on the disk."""
        try:
            pid = int((self.data / "postmaster.pid").read_text().splitlines()[0])
        except (OSError, ValueError, IndexError):
            return
        deadline = time.monotonic() + ENDS_S
        if runs(pid, "postgres"):
            os.kill(pid, signal.SIGINT)
        while runs(pid, "postgres"):
            if time.monotonic() > deadline:
                raise SystemExit(f"PostgreSQL: expected process {pid} to end within {ENDS_S:g} s, it runs on")
            time.sleep(0.1)

    def make(self, database: str, password: str) -> str:
        """The address of a database, made if it is not there."""
        import psycopg2

        connection = psycopg2.connect(
            host=HOST, port=self.port, user=USER, password=password, dbname="postgres"
        )
        connection.autocommit = True
        try:
            with connection.cursor() as cursor:
                cursor.execute("SELECT 1 FROM pg_database WHERE datname = %s", (database,))
                if cursor.fetchone() is None:
                    cursor.execute(f'CREATE DATABASE "{database}"')
        finally:
            connection.close()
        return f"postgresql+psycopg2://{USER}:{password}@{HOST}:{self.port}/{database}"

    def _require_reach(self) -> None:
        words = ["test", "-x", str(self.folder)]
        if self.user and subprocess.run(words, user=self.user, cwd="/", check=False).returncode:
            raise SystemExit(
                f"--folder: expected one that the user {self.user} reaches, received {self.folder} "
                "(a folder above it is closed to others)"
            )

    def _call(self, program: str, *words: object) -> None:
        done = subprocess.run(
            [postgres_program(program), *map(str, words)],
            user=self.user, cwd="/", stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise SystemExit(f"{program}: {done.stderr.strip()}")


def postgres_program(name: str) -> str:
    """The path of a program of PostgreSQL, of the newest version that Debian has installed."""
    found = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"), key=lambda path: float(path.parts[4]))
    path = str(found[-1]) if found else shutil.which(name)
    if path is None:
        raise SystemExit(f"{name}: expected PostgreSQL (Debian: apt-get install postgresql), found none")
    return path


def free_port() -> int:
    """A port of the loopback that nobody uses."""
    with socket.socket() as free:
        free.bind((HOST, 0))
        return int(free.getsockname()[1])


def write_secret(path: Path, text: str) -> None:
    """Write a file that only its owner reads."""
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as stream:
        stream.write(text)


def secret(path: Path) -> str:
    """A password of the folder, drawn at the first call."""
    if not path.exists():
        write_secret(path, secrets.token_urlsafe(24))
    return path.read_text(encoding="ascii").strip()


def mlflow_command(folder: Path, port: int, *, auth: bool) -> list[str]:
    """The server's command line, on which no password stands."""
    hosts = [f"{name}{suffix}" for name in ("localhost", HOST) for suffix in ("", f":{port}")]
    origins = [f"http://{name}:{port}" for name in ("localhost", HOST)]
    # One process with threads: several are killed and begun anew for ever where they take more than 5 s to start.
    return [
        *(sys.executable, "-m", "mlflow", "server", "--host", HOST, "--port", str(port), "--workers", "1"),
        *("--serve-artifacts", "--artifacts-destination", str(folder / "artifacts")),
        *("--allowed-hosts", ",".join(hosts), "--cors-allowed-origins", ",".join(origins)),
        *(["--app-name", "basic-auth"] if auth else []),
    ]


def environment(folder: Path, postgres: Postgres, password: str, *, auth: bool) -> dict[str, str]:
    """What the server reads its passwords from."""
    found = {
        **os.environ,
        "MLFLOW_BACKEND_STORE_URI": postgres.make("mlflow", password),
        "MLFLOW_DISABLE_TELEMETRY": "true",
    }
    if auth:
        settings = folder / "auth.ini"
        address = postgres.make("access", password)
        write_secret(settings, AUTH.format(address=address, user=USER, password=secret(folder / "password")))
        found["MLFLOW_AUTH_CONFIG_PATH"] = str(settings)
        found["MLFLOW_FLASK_SERVER_SECRET_KEY"] = secret(folder / "session_key")
    return found


def serve(folder: Path, port: int, database_port: int, *, auth: bool) -> int:
    """Start both, say how to use them, and end both when asked to."""
    folder.mkdir(parents=True, exist_ok=True)
    # PostgreSQL's user has to reach its own folder in it; nobody needs to list it.
    folder.chmod(0o711)
    state = folder / "server.json"
    if state.exists() and runs(
        known := json.loads(state.read_text(encoding="utf-8"))["pid"], Path(__file__).name
    ):
        raise SystemExit(f"{folder}: expected no server of it, found one that runs as process {known}")
    if socket.socket().connect_ex((HOST, port)) == 0:
        raise SystemExit(f"port: expected one that is free, received {port}")
    password = secret(folder / "database_password")
    postgres = Postgres(folder / "postgres", database_port)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    process: subprocess.Popen[bytes] | None = None
    try:
        postgres.start(password)
        with (folder / "mlflow.log").open("ab") as log:
            process = subprocess.Popen(
                mlflow_command(folder, port, auth=auth), stdout=log, stderr=log, start_new_session=True,
                env=environment(folder, postgres, password, auth=auth), cwd=folder,
            )  # fmt: skip
        state.write_text(
            json.dumps({"pid": os.getpid(), "port": port, "server": process.pid}), encoding="utf-8"
        )
        wait(process, port, folder / "mlflow.log")
        print(said(folder, port, auth=auth), flush=True)
        return process.wait()
    except KeyboardInterrupt:
        return 0
    finally:
        end(process)
        postgres.stop()
        state.unlink(missing_ok=True)
        print("The server has ended; its runs stay in the folder.", flush=True)


def wait(process: subprocess.Popen[bytes], port: int, log: Path) -> None:
    """Wait until the server answers."""
    deadline = time.monotonic() + STARTS_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            with urllib.request.urlopen(f"http://{HOST}:{port}/health", timeout=2):
                return
        except OSError:
            time.sleep(0.3)
    raise SystemExit(
        f"the server did not start; the end of {log}:\n{log.read_text(errors='replace')[-2000:]}"
    )


def said(folder: Path, port: int, *, auth: bool) -> str:
    """How to use the server."""
    lines = [f"MLflow: http://{HOST}:{port} (Ctrl-C ends it)", "In another terminal:"]
    lines.append(f"  export MLFLOW_TRACKING_URI=http://{HOST}:{port}")
    if auth:
        lines.append(
            f"  export MLFLOW_TRACKING_USERNAME={USER} MLFLOW_TRACKING_PASSWORD=$(cat {folder}/password)"
        )
    return "\n".join(lines)


def end(process: subprocess.Popen[bytes] | None) -> None:
    """End the server with all of its processes."""
    if process is None:
        return
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(ENDS_S if number == signal.SIGTERM else None)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def runs(pid: int, name: str) -> bool:
    """Whether a process is one of that name: its number may have been given out again."""
    try:
        return name in Path(f"/proc/{pid}/cmdline").read_text(errors="replace")
    except OSError:
        return False


def down(folder: Path) -> int:
    """End the server of a folder."""
    state = folder / "server.json"
    pid = json.loads(state.read_text(encoding="utf-8"))["pid"] if state.exists() else None
    if pid is None or not runs(pid, Path(__file__).name):
        print(f"{folder}: no server runs.")
        state.unlink(missing_ok=True)
        return 0
    os.kill(pid, signal.SIGTERM)
    deadline = time.monotonic() + 2 * ENDS_S
    while runs(pid, Path(__file__).name) and time.monotonic() < deadline:
        time.sleep(0.2)
    return int(runs(pid, Path(__file__).name))


def main(arguments: list[str] | None = None) -> int:
    """Start the server, or end it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "--folder", type=Path, default=Path(".server"), help="databases, artifacts, passwords, logs"
    )
    parser.add_argument("--port", type=int, default=5000)
    parser.add_argument("--database-port", type=int, default=0, help="0: any that is free")
    parser.add_argument(
        "--no-auth", action="store_true", help="no password: every user of this machine may write"
    )
    parser.add_argument("--down", action="store_true", help="end the server of the folder")
    given = parser.parse_args(arguments)
    folder = given.folder.resolve()
    if given.down:
        return down(folder)
    return serve(folder, given.port, given.database_port, auth=not given.no_auth)


if __name__ == "__main__":
    sys.exit(main())
