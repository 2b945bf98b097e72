"""Workers of a Dask cluster, for studies on more than one machine; the package is an extra ("cluster")."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from typing import Any

from harness_opt.errors import ProblemError
from harness_opt.studies.shared_problem import Shared, carried_folder

CONNECT = 10.0  # s for a scheduler to answer
REMEDY = 'pip install "harness-opt[cluster]"'

try:
    from distributed import Client, WorkerPlugin
    from distributed.comm import get_address_host_port  # type: ignore[attr-defined]  # of a package without types
except ImportError as missing:
    raise ProblemError(f"--scheduler: found no Dask ({missing}), expected it; try {REMEDY}") from missing


class Carrier(WorkerPlugin):
    """Sets up every worker, those that join later too: brings it the problem's files, and holds it to one thread.

    Args:
        files: contents by name and sha256.
    """

    idempotent = True

    def __init__(self, files: Mapping[tuple[str, str], bytes]):
        self.name = "harness-opt-" + "-".join(digest[:8] for _, digest in sorted(files))
        self._files = dict(files)

    def setup(self, worker: Any) -> None:
        """Write the files where :class:`~harness_opt.studies.shared_problem.LocalProblem` looks for them."""
        from threadpoolctl import threadpool_limits

        threadpool_limits(1)
        for (name, digest), content in self._files.items():
            folder = carried_folder(digest)
            folder.mkdir(parents=True, exist_ok=True)
            aside = folder / f".{name}.{abs(hash(worker))}.part"  # workers of one machine write the same file
            aside.write_bytes(content)
            aside.replace(folder / name)


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
    files = {(path.name, digest): path.read_bytes() for path, digest in shared.paths().items()}
    try:
        client = Client(address, timeout=CONNECT, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:  # Dask's own errors of connecting are OSErrors
        raise ProblemError(_missing(address, error)) from error
    with client:
        client.register_plugin(Carrier(files))
        yield client.get_executor(pure=False)  # type: ignore[no-untyped-call]


def _missing(address: str, error: Exception) -> str:
    words = " ".join(str(error).split())
    return f"--scheduler: found no Dask scheduler at {address} ({words}), expected its address, such as tcp://host:8786"
