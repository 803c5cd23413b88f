"""``--presses``: the first of the presses to learn from, with weights and a name of their own."""

from __future__ import annotations

import pytest

from tactibench import UserError

pytestmark = pytest.mark.long


def test_only_the_presses_to_learn_from_are_fewer(planned):
    whole, few = planned(), planned(presses=7)
    assert whole.frames.count("fit") == 30
    assert few.frames.fit[0].scenes == whole.frames.fit[0].scenes[:7]
    for role in ("validation", "test"):
        assert few.frames.count(role) == whole.frames.count(role)
    assert [w.key for w in few.frames.test] == [w.key for w in whole.frames.test]


def test_what_a_regime_adds_stays(planned):
    few = planned(regime="multiple", presses=7)
    assert [len(wanted.scenes) for wanted in few.frames.fit] == [7, 20, 20]


def test_weights_and_runs_have_identities_of_their_own(planned):
    plans = [planned(), planned(presses=7), planned(presses=8)]
    assert len({plan.weights.folder for plan in plans}) == 3
    assert len({plan.name for plan in plans}) == 3
    assert "-n7-s0-" in plans[1].name


def test_the_record_says_so_and_is_whole(run, tiny):
    stored = run(presses=7)
    record = stored.record
    assert tiny.TinyModel.fits == [7]
    assert record.partial is False
    assert record.limits.presses == 7
    assert (record.training.presses, record.data.train) == (7, 7)
    assert "|seed:0|presses:7|" in record.signature
    assert record.training.device == "cpu"


@pytest.mark.parametrize("count", [30, 31])
def test_as_many_as_there_are_or_more_are_refused(planned, count):
    with pytest.raises(UserError, match="must be less than the 30 presses"):
        planned(presses=count)


def test_a_quick_run_takes_of_the_fewer(planned):
    plan = planned(presses=5, quick=True)
    assert plan.frames.count("fit") == 5
