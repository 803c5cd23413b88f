"""Specs and parameters: what may be declared and what may be set."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stubs import StubEncoder

from tactibench import (
    CommandSpec,
    EncoderSpec,
    ModelSpec,
    Parameter,
    SensorSpec,
    UserError,
)
from tactibench.plugins import Origin
from tactibench.records import BoundSpec

WIDTH = Parameter("width", 16, "channels", low=1, high=64)
RATE = Parameter("rate", 0.5, "a rate")
NOISE = Parameter("noise", True, "noise on or off")
WHOLE = "a whole number, at least 1, at most 64"
WORD = Parameter("recipe", "default", "recipe", choices=("default", "paper"))


@given(st.integers().filter(lambda n: not 1 <= n <= 64))
def test_whole_numbers_out_of_range_are_refused(value: int) -> None:
    with pytest.raises(UserError, match=rf"'width' is -?\d+, but must be {WHOLE}"):
        WIDTH.parse(str(value))


@pytest.mark.parametrize(
    ("parameter", "text", "sentence"),
    [
        (
            WIDTH,
            "wide",
            f"parameter 'width' is 'wide', but must be {WHOLE}.",
        ),
        (WIDTH, "", f"parameter 'width' is '', but must be {WHOLE}."),
        (RATE, "much", "parameter 'rate' is 'much', but must be a finite number."),
        (RATE, "nan", "parameter 'rate' is nan, but must be a finite number."),
        (NOISE, "maybe", "parameter 'noise' is 'maybe', but must be yes or no."),
        (WORD, "papper", "parameter 'recipe' is 'papper'; allowed: default, paper."),
    ],
)
def test_values_that_are_not_allowed(parameter: Parameter, text: str, sentence: str) -> None:
    with pytest.raises(UserError) as caught:
        parameter.parse(text)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("parameter", "value", "sentence"),
    [
        (WIDTH, 0, f"parameter 'width' is 0, but must be {WHOLE}."),
        (
            WIDTH,
            8.0,
            f"parameter 'width' is 8.0, but must be {WHOLE}.",
        ),
        (
            WIDTH,
            True,
            f"parameter 'width' is True, but must be {WHOLE}.",
        ),
        (
            WIDTH,
            None,
            f"parameter 'width' is None, but must be {WHOLE}.",
        ),
        (RATE, float("inf"), "parameter 'rate' is inf, but must be a finite number."),
        (RATE, "0.5", "parameter 'rate' is '0.5', but must be a finite number."),
        (NOISE, 1, "parameter 'noise' is 1, but must be yes or no."),
        (WORD, 3, "parameter 'recipe' is 3; allowed: default, paper."),
    ],
)
def test_values_that_python_may_not_give(parameter: Parameter, value: Any, sentence: str) -> None:
    spec = EncoderSpec("e", "no.such.module:Class", "", (parameter,))
    with pytest.raises(UserError) as caught:
        spec.build(**{parameter.name: value})  # before anything is imported
    assert str(caught.value) == sentence


def test_what_is_built_takes_numbers_of_numpy_and_no_strangers() -> None:
    spec = EncoderSpec("e", "stubs:StubEncoder", "", (WIDTH, RATE))
    spec.check({"width": np.int64(8), "rate": np.float32(1.0)})
    spec.check({"rate": 1})
    with pytest.raises(UserError, match=r"no parameter 'widht'; did you mean 'width'\?"):
        spec.build(widht=8)


def test_settings_fill_in_defaults_and_refuse_strangers() -> None:
    spec = EncoderSpec("e", "m:C", "", (WIDTH, WORD))
    assert spec.settings({"width": "8"}) == {"width": 8, "recipe": "default"}
    with pytest.raises(UserError, match=r"'e' has no parameter 'widht'; did you mean 'width'\?"):
        spec.settings({"widht": "8"})
    with pytest.raises(UserError, match=r"'bare' has no parameter 'x'; known: none\."):
        EncoderSpec("bare", "m:C", "").settings({"x": "1"})


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: Parameter("a b", 1, ""), "no name that Python could take"),
        (lambda: Parameter("a", 9, "", high=8), "the default of parameter 'a' is 9"),
        (lambda: ModelSpec("", "m:C", ""), "may hold letters"),
        (lambda: ModelSpec("m", "package.module.Class", ""), "package.module:Class"),
        (lambda: EncoderSpec("e", "m:C", "", (WIDTH, WIDTH)), "two parameters of the same name"),
        (lambda: ModelSpec("m", "m:C", "", answers=("contact",)), "answers"),
        (lambda: SensorSpec("s", "m:C", "", origin="imagined"), "origin"),
        (lambda: SensorSpec("s", "m:C", "", reference_of="t"), "both reference_of and scenes"),
    ],
)
def test_a_spec_that_cannot_be_right_is_refused_when_it_is_made(make: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        make()


def test_load_imports_the_target() -> None:
    assert CommandSpec("e", "collections:OrderedDict", "").load().__name__ == "OrderedDict"
    assert EncoderSpec("e", "stubs:StubEncoder", "").load() is StubEncoder


@pytest.mark.parametrize(
    ("target", "sentence"),
    [
        (
            "stubs:StubSensor",
            "'m' cannot be used, because stubs:StubSensor does not inherit from tactibench.Model",
        ),
        ("math:sqrt", "import Model from tactibench and write `class sqrt"),
        (
            "tactibench:Model",
            "'m' cannot be used, because tactibench:Model lacks fit, load",
        ),
    ],
)
def test_a_class_that_is_no_model_is_named_with_what_to_do(target: str, sentence: str) -> None:
    with pytest.raises(UserError) as caught:
        ModelSpec("m", target, "").load()
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("target", "reason"),
    [("no_such_module_x:C", "ModuleNotFoundError"), ("math:nothing", "AttributeError")],
)
def test_a_target_that_does_not_load_is_one_sentence(target: str, reason: str) -> None:
    for spec in (EncoderSpec("e", target, ""), CommandSpec("e", target, "")):
        with pytest.raises(UserError) as caught:
            spec.load()
        assert str(caught.value).startswith(f"'e' cannot be used, because {target} does not load (")
        assert reason in str(caught.value)
        assert caught.value.__cause__ is not None


def test_a_recipe_has_defaults_of_its_own_that_a_user_may_change() -> None:
    recipe = Parameter("recipe", "default", "the recipe", choices=("default", "paper"))
    spec = ModelSpec("m", "a:B", "", (recipe, WIDTH), recipes={"paper": {"width": 64}})
    assert spec.settings({})["width"] == 16
    assert spec.settings({"recipe": "paper"})["width"] == 64
    assert spec.settings({"recipe": "paper", "width": "32"})["width"] == 32
    own = ModelSpec("m", "a:B", "", (recipe, WIDTH), recipes={"default": {"width": 64}})
    assert own.settings({}) == own.settings({"recipe": "default"})
    assert own.settings({})["width"] == 64
    with pytest.raises(ValueError, match="recipe 'paper' of 'm' sets"):
        ModelSpec("m", "a:B", "", (recipe, WIDTH), recipes={"paper": {"depth": 1}})
    with pytest.raises(ValueError, match="sets"):  # no such choice of recipe to be made
        ModelSpec("m", "a:B", "", (WIDTH,), recipes={"paper": {"width": 64}})


def test_a_label_names_the_recipe_and_what_differs_from_it() -> None:
    recipe = Parameter("recipe", "default", "the recipe", choices=("default", "paper"))
    spec = ModelSpec("m", "a:B", "", (recipe, WIDTH), recipes={"paper": {"width": 32}})
    for texts, settings in (
        ({}, []),
        ({"recipe": "paper"}, ["recipe"]),
        ({"recipe": "paper", "width": "16"}, ["recipe", "width"]),
    ):
        bound = BoundSpec(spec, spec.settings(texts), Origin("p", "p", "1"))
        assert bound.component.settings == settings
    assert spec.settings_of_record({"width": 32, "smell": 1})["width"] == 32
