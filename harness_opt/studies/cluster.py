"""Workers of a Dask cluster, for studies on more than one machine; the package is an extra ("cluster")."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from typing import Any

from harness_opt.errors import ProblemError
from harness_opt.files.whole_folder import write_whole
from harness_opt.studies.shared_problem import Shared, carried_root

CONNECT = 10.0  # s for a scheduler to answer
REMEDY = 'pip install "harness-opt[cluster]"'

try:
    from distributed import Client, WorkerPlugin
    from distributed.comm import get_address_host_port
    from distributed.core import rpc
    from distributed.security import Security
except ImportError as missing:
    raise ProblemError(f"--scheduler: found no Dask ({missing}), expected it; try {REMEDY}") from missing


class Carrier(WorkerPlugin):
    """Sets up every worker, those that join later too: brings it the problem's files, and holds it to one thread.

    Args:
        study: its name.
        files: contents by name and sha256.
    """

    idempotent = True

    def __init__(self, study: str, files: Mapping[tuple[str, str], bytes]):
        self.name, self._study = f"harness-opt-{study}", study
        self._files = dict(files)

    def setup(self, worker: Any) -> None:
        """Write the files where :class:`~harness_opt.studies.shared_problem.LocalProblem` looks for them."""
        from threadpoolctl import threadpool_limits

        threadpool_limits(1)
        for (name, digest), content in self._files.items():
            folder = carried_root(self._study) / digest
            folder.mkdir(exist_ok=True)
            write_whole(folder / name, content)  # workers of one machine write the same file


@contextlib.contextmanager
def cluster(address: str, shared: Shared) -> Iterator[Executor]:
    """Give an executor of the Dask cluster whose scheduler listens at ``address``.

    Args:
        address: such as tcp://host:8786.
        shared: of the study; its files are sent to the workers.

    Raises:
        ProblemError: no scheduler answers there.
    """
    try:
        get_address_host_port(address, strict=True)  # what is no address at all must not be waited for
    except ValueError as error:
        raise ProblemError(_missing(address, error)) from error
    if address.startswith("tls:") and Security().get_connection_args("client").get("ssl_context") is None:
        raise ProblemError(
            _missing(address, ValueError("no certificates in Dask's configuration, distributed.comm.tls"))
        )
    files = {(path.name, digest): path.read_bytes() for path, digest in shared.paths().items()}
    try:
        asyncio.run(asyncio.wait_for(_asked(address), CONNECT))
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # refused; TLS without its keys
        raise ProblemError(_missing(address, error)) from error
    _quiet()
    with client:
        client.register_plugin(Carrier(shared.name, files))
        yield client.get_executor(pure=False)


async def _asked(address: str) -> None:
    """Return once a scheduler has said who it is; a client would wait for ever for one that says nothing."""
    scheduler = rpc(address, timeout=CONNECT, connection_args=Security().get_connection_args("client"))
    try:
        await scheduler.identity()
    finally:
        await scheduler.close_rpc()


def _quiet() -> None:
    """Keep Dask's logs off stderr: what stops a study comes as an exception, and everything else it mends itself.

    They stay so: the last ones are written while Python ends.
    """
    known = list(logging.root.manager.loggerDict)  # Dask gives each of its rooms a level of its own
    for name in ("distributed", "asyncio", "tornado"):
        for one in (name, *(other for other in known if other.startswith(f"{name}."))):
            logging.getLogger(one).setLevel(logging.CRITICAL + 1)


def _missing(address: str, error: Exception) -> str:
    words = " ".join(str(error).split())
    return f"--scheduler: found no Dask scheduler at {address} ({words}), expected its address, such as tcp://host:8786"
