"""Fast construction of frozen dataclass values."""

from dataclasses import FrozenInstanceError, dataclass, field, fields, replace
from decimal import Decimal

import pytest

from drivecomm.protocol import Reading, frozen_factory, new_reading


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    drive: str
    number: int = 0
    parts: tuple[str, ...] = ()
    counted: list[int] = field(default_factory=list)


def test_frozen_factory_builds_the_same_value_as_the_constructor():
    made = frozen_factory(Value)(drive="fan", number=3, counted=[1])
    assert made == Value(drive="fan", number=3, counted=[1])
    assert type(made) is Value
    assert repr(made) == repr(Value(drive="fan", number=3, counted=[1]))
    assert replace(made, number=4).number == 4


def test_reading_from_its_factory_equals_one_from_the_constructor():
    given = {"parameter": "481", "value": Decimal("1.5"), "raw": 15, "unit": "A", "type": "I16", "name": "current"}
    made = new_reading(**given)
    assert made == Reading(**given)
    assert hash(made) == hash(Reading(**given))
    assert {each.name: getattr(made, each.name) for each in fields(made)} == given | {
        "text": "", "note": "", "doubt": "", "time_s": 0.0,
    }  # fmt: skip


def test_value_from_a_frozen_factory_is_immutable():
    made = frozen_factory(Value)(drive="fan", counted=[])
    with pytest.raises(FrozenInstanceError):
        made.number = 5
    with pytest.raises(AttributeError):
        object.__setattr__(made, "other", 5)


@pytest.mark.parametrize("given", [{}, {"drive": "fan"}, {"drive": "fan", "counted": [], "other": 1}])
def test_frozen_factory_refuses_missing_and_unknown_fields(given):
    with pytest.raises(TypeError):
        frozen_factory(Value)(**given)


def test_class_with_post_init_has_no_frozen_factory():
    @dataclass(frozen=True, slots=True, kw_only=True)
    class Checked:
        number: int

        def __post_init__(self) -> None:
            """Check the number."""

    with pytest.raises(TypeError, match="Checked looks at its fields when it is made"):
        frozen_factory(Checked)
