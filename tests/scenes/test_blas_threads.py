"""One BLAS thread inside, the user's own number outside."""

import threading

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

import roundel
from roundel.scenes.blas_threads import one_blas_thread
from roundel.solver.ambiguity.observation import Verdict


def blas_threads() -> list[int]:
    return [library["num_threads"] for library in ThreadpoolController().select(user_api="blas").info()]


@pytest.fixture(autouse=True)
def two_threads():
    # So that one thread differs from the rest, also on a machine with a single core.
    with threadpool_limits(2, user_api="blas"):
        yield


def test_one_thread_inside_and_two_again_after() -> None:
    assert max(blas_threads()) == 2
    with one_blas_thread():
        assert set(blas_threads()) == {1}
        with one_blas_thread():
            pass
        assert set(blas_threads()) == {1}
    assert max(blas_threads()) == 2


def test_restored_after_an_error() -> None:
    with pytest.raises(KeyError), one_blas_thread():
        raise KeyError("x")
    assert max(blas_threads()) == 2


def test_another_python_thread_does_not_restore_it() -> None:
    def enter_and_leave() -> None:
        with one_blas_thread():
            pass

    with one_blas_thread():
        other = threading.Thread(target=enter_and_leave)
        other.start()
        other.join(10)
        assert set(blas_threads()) == {1}
    assert max(blas_threads()) == 2


class Spy:
    """Knowledge that notes the number of threads while a frame is solved."""

    def __init__(self) -> None:
        self.seen: list[int] = []

    def problem(self) -> str:
        return ""

    def verdict(self, observation: object) -> Verdict:
        self.seen = blas_threads()
        return Verdict(0.0, "")


def test_locate_solves_with_one_thread() -> None:
    y, x = np.mgrid[:120, :160]
    disc = np.where(np.hypot((x - 80) / 1.2, y - 60) < 30, 40, 200).astype(np.uint8)
    spy = Spy()
    assert len(roundel.locate(disc, 0.08, knowledge=spy)) == 1
    assert set(spy.seen) == {1}
