"""Workers of a study: a pool of processes that loses none of its work, behind the interface of every executor.

A worker that dies takes a standard pool with it ("BrokenProcessPool"). Here a pool is made anew, and the variants that
were with the workers run again, one at a time until each is done, so that one that kills its worker is known by it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

from harness_opt.errors import HarnessError

AHEAD = 2  # tasks handed out for each worker of our own: one to work on, one to go on with
DEATHS = 3  # of workers on one and the same task, the last ones alone, after which it is given up
AHEAD_OF_OTHERS = 1000  # tasks handed out to an executor that may have any number of workers

Task = tuple[Any, ...]  # the arguments of the function
Finished = tuple[Task, Any]  # with its result, or the exception that ended it


def cores() -> int:
    """Return how many cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # macOS, Windows
        return os.cpu_count() or 1


class Pool:
    """Processes with one thread each for linear algebra, which end when this object, or its process, does.

    Args:
        workers: how many; None takes all cores.
    """

    def __init__(self, workers: int | None):
        # started anew and not forked: libraries hold locks and threads that no copy survives
        context = multiprocessing.get_context("spawn")
        self._end, self._rope = context.Pipe(duplex=False)
        self.executor = ProcessPoolExecutor(workers or cores(), context, _begin, (self._end,))

    def close(self) -> None:
        """End the workers, whatever they are at."""
        self._rope.close()
        self.executor.shutdown(wait=True, cancel_futures=True)
        self._end.close()


def _begin(end: Connection) -> None:
    """Set up a worker; ``end`` is of a pipe that nothing is ever written to, and that closes with the pool."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the study's to handle
    threading.Thread(target=_end_with, args=(end,), daemon=True).start()
    threadpool_limits(1)


def _end_with(end: Connection) -> None:
    end.poll(None)
    os._exit(1)  # the main thread is at work, or waits for work that nobody will send


@dataclass
class Crew:
    """Runs tasks on an executor, each until it has a result.

    Args:
        function: what is run; importable on the workers.
        executor: any; None makes pools of processes.
        workers: of these pools; None takes all cores.
        stop: asked before a task is handed out; once it says True, only what runs is waited for.
    """

    function: Callable[..., Any]
    executor: Executor | None = None
    workers: int | None = None
    stop: Callable[[], bool] | None = None
    _pool: Pool | None = None
    _running: dict[Future[Any], Task] = field(default_factory=dict)

    def run(self, tasks: Iterable[Task]) -> Iterator[Finished]:
        """Yield every task with its result, or the exception that ended it, as they finish.

        Raises:
            HarnessError: the executor ended, or cancelled what it was given.
        """
        ahead = AHEAD_OF_OTHERS if self.executor is not None else AHEAD * (self.workers or cores())
        try:
            yield from self._finished(iter(tasks), ahead)
        finally:
            self.close()

    def _finished(self, waiting: Iterator[Task], ahead: int) -> Iterator[Finished]:
        """Yield tasks as they finish, ``ahead`` of them handed out at any time."""
        while True:
            if self.stop is not None and self.stop():
                self._call_back()
                waiting = iter(())
            while len(self._running) < ahead and (task := next(waiting, None)) is not None:
                self._submit(task)
            if not self._running:
                return
            done, _ = wait(self._running, return_when=FIRST_COMPLETED)
            broken: list[Task] = []
            for future in [future for future in self._running if future in done]:  # in order, where order is known
                task = self._running.pop(future)
                outcome = self._outcome(future)
                if self.executor is None and isinstance(outcome, BrokenProcessPool):
                    broken.append(task)
                else:
                    yield task, outcome
            if broken:
                yield from self._again([*broken, *self._drop_pool()])

    def _outcome(self, future: Future[Any]) -> Any:
        """Return the result of a future, or the exception that ended it.

        Raises:
            HarnessError: it was cancelled from elsewhere.
        """
        try:
            error = future.exception()
        except CancelledError:
            raise HarnessError("the workers are gone: the executor cancelled what it was given") from None
        return future.result() if error is None else error

    def _submit(self, task: Task) -> None:
        if self.executor is None and self._pool is None:
            self._pool = Pool(self.workers)
        executor = self._pool.executor if self._pool else self.executor
        try:
            future = executor.submit(self.function, *task)  # type: ignore[union-attr]
        except BrokenProcessPool as error:
            if self.executor is not None:
                raise HarnessError(f"the workers are gone: {error}") from error
            future = Future()  # known as broken when it is looked at, like those that were handed out before
            future.set_exception(error)
        except RuntimeError as error:
            raise HarnessError(f"the workers are gone: {error}") from error
        self._running[future] = task

    def _call_back(self) -> None:
        """Take back what nobody has begun."""
        self._running = {future: task for future, task in self._running.items() if not future.cancel()}

    def _drop_pool(self) -> list[Task]:
        """End the pool; return the tasks that were with it."""
        lost = list(self._running.values())
        self._running.clear()
        if self._pool is not None:
            self._pool.close()
            self._pool = None
        return lost

    def _again(self, tasks: list[Task]) -> Iterator[Finished]:
        """Yield tasks that were with a broken pool, run again, one at a time."""
        for task in tasks:
            for _ in range(1, DEATHS):
                self._submit(task)
                (future,) = self._running
                wait([future])
                del self._running[future]
                outcome = self._outcome(future)
                if not isinstance(outcome, BrokenProcessPool):
                    break
                self._drop_pool()
            yield task, outcome

    def close(self) -> None:
        """Let go of what runs, and of the pool."""
        self._call_back()
        self._drop_pool()
