"""Answers survive being stored."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tactibench import Contacts, PlatePose
from tactibench.records import pack, unpack_contacts, unpack_plates

FINITE = st.floats(-100, 100)


@st.composite
def contacts(draw: st.DrawFn) -> Contacts:
    n = draw(st.integers(0, 4))
    std = draw(st.none() | hnp.arrays(float, (n, 3), elements=st.floats(0, 9)))
    return Contacts(
        draw(hnp.arrays(float, (n, 2), elements=FINITE)),
        draw(hnp.arrays(float, n, elements=FINITE)),
        draw(hnp.arrays(float, n, elements=st.floats(0, 1))),
        std,
    )


@given(st.lists(contacts(), max_size=6))
def test_contacts_come_back(answers: list[Contacts]) -> None:
    again = unpack_contacts(pack(answers, "contacts"))
    assert len(again) == len(answers)
    for one, two in zip(answers, again, strict=True):
        for name in ("xy", "depth", "score"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
        if one.std is None or not len(one):
            assert two.std is None
        else:
            np.testing.assert_array_equal(one.std, two.std)


PLATES = st.none() | st.builds(PlatePose, FINITE, FINITE, st.none() | st.tuples(FINITE, FINITE))


@given(st.lists(PLATES, max_size=6))
def test_plates_come_back(answers: list[PlatePose | None]) -> None:
    assert unpack_plates(pack(answers, "plate")) == tuple(answers)


@pytest.mark.parametrize(
    ("answer", "kind"),
    [(PlatePose(1, 2), "contacts"), (None, "contacts"), (Contacts.none(), "plate")],
)
def test_answers_of_another_kind_are_no_silent_miss(answer: object, kind: str) -> None:
    with pytest.raises(TypeError, match="1 answers are no"):
        pack([answer], kind)  # type: ignore[list-item]
