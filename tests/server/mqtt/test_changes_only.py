"""Doors that publish only changes: no significant change is lost, and constant values are repeated at intervals."""

from decimal import Decimal

from doors import listening, open_door
from hypothesis import given, strategies as st
from mosquitto import mosquitto, needs_mosquitto, until
from served_core import PLANT, awaited, core_of

from drivecomm.plant import read_plant
from drivecomm.server.mqtt.changes import ChangeDetector, ChangeRules, tag_deadband
from drivecomm.server.mqtt.content import PublishedValue
from drivecomm.server.plant_service import PlantForDoors


def sample(value, *, time_s=0.0, quality="good", text="", note="", name="output_current"):
    return PublishedValue("pump", name, value, "A", text, quality, note, round(time_s * 1000))


def published(rules, samples):
    """Return the values that are published if each of them is delivered immediately."""
    changes, found = ChangeDetector(rules), []
    for each in samples:
        if changes.is_change(each):
            changes.published(each)
            found.append(each.value)
    return found


def test_constant_value_is_published_once():
    course = [sample(Decimal(each)) for each in ("1.0", "1.0", "1.1", "1.1", "1.0")]
    assert published(ChangeRules(), course) == [Decimal("1.0"), Decimal("1.1"), Decimal("1.0")]


def test_slowly_drifting_value_is_published():
    course = [sample(Decimal(each)) for each in ("1.00", "1.05", "1.10", "1.15", "1.20", "1.22")]
    found = published(ChangeRules(deadbands={"output_current": 0.1}), course)
    assert found == [Decimal("1.00"), Decimal("1.15")]


def test_deadband_applies_to_its_quantity_only():
    rules = ChangeRules(deadbands={"output_frequency": 5})
    assert published(rules, [sample(1), sample(2)]) == [1, 2]


def test_deadband_of_a_tag_overrides_that_of_the_door():
    rules = ChangeRules(deadbands={"output_current": 5})
    changes = ChangeDetector(rules, lambda drive, name: {("pump", "output_current"): 0.5}.get((drive, name)))
    changes.published(sample(Decimal("1.0")))
    assert [changes.is_change(sample(Decimal(each))) for each in ("1.5", "1.6")] == [False, True]
    other = sample(Decimal("1.6"))._replace(drive="fan")
    changes.published(other)
    assert not changes.is_change(other._replace(value=Decimal("6.6")))


def test_changed_quality_text_or_note_is_published_despite_the_deadband():
    rules = ChangeRules(deadbands={"output_current": 100})
    first = sample(1)
    for other in (sample(1, quality="stale"), sample(None, quality="bad"), sample(1, text="on"), sample(1, note="old")):
        assert published(rules, [first, other, first]) == [1, other.value, 1]


def test_constant_value_is_repeated_at_intervals_and_after_a_clock_set_back():
    rules = ChangeRules(at_least_every_s=60)
    course = [sample(1, time_s=time_s) for time_s in (0, 30, 59, 60, 90, 119.9, 120, 20)]
    changes, times = ChangeDetector(rules), []
    for each in course:
        if changes.is_change(each):
            changes.published(each)
            times.append(each.time_ms / 1000)
    assert times == [0, 60, 120, 20]


def test_undelivered_value_is_no_base_for_comparison():
    changes = ChangeDetector(ChangeRules())
    assert changes.is_change(sample(1))
    assert changes.is_change(sample(1))


@given(st.lists(st.decimals(-100, 100, places=1), min_size=1), st.decimals(0, 20, places=1))
def test_last_published_value_is_within_the_deadband(values, deadband):
    changes, known = ChangeDetector(ChangeRules(deadbands={"output_current": float(deadband)})), None
    for value in values:
        if changes.is_change(sample(value)):
            changes.published(sample(value))
            known = value
        assert abs(known - value) <= deadband


@needs_mosquitto
@awaited
async def test_door_publishes_changes_only(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path) as (core, control),
            listening(broker) as client,
            open_door(core, broker, publish="changes", deadband={"output_frequency": 1}),
        ):
            plant = PlantForDoors(core, "the same")

            def polls():
                return sum(each.polls for each in plant.lines())

            await until(lambda: (client.latest("pump/output_frequency") or {}).get("quality") == "good")
            told, before = len(client.payloads("pump/output_frequency")), polls()
            await until(lambda: polls() > before + 100)
            again = [each for each in client.payloads("pump/output_frequency")[told:] if each["quality"] == "good"]
            # On a busy machine values may go stale; each of those is published again when it is fresh.
            assert len(again) < 10
            control.order("power", drive="pump", state="off")
            await until(lambda: client.latest("pump/output_frequency")["quality"] == "bad")


@awaited
async def test_deadband_of_a_tag_follows_a_changed_plant_file(tmp_path):
    tagged = "tags = { output_frequency = { deadband = 1000 } }\nnetwork = { http"
    async with core_of(tmp_path, PLANT.replace("network = { http", tagged)) as (core, _control):
        plant = PlantForDoors(core, "hall")
        assert tag_deadband(plant, "pump", "output_frequency") == 1000
        assert tag_deadband(plant, "fan", "output_frequency") is None
        assert tag_deadband(plant, "gone", "output_frequency") is None
        (tmp_path / "plant.toml").write_text(PLANT)
        # A changed tag leaves the drive the same, so that a kept motor keeps running.
        assert await core.changed(read_plant(tmp_path / "plant.toml")) == []
        assert tag_deadband(plant, "pump", "output_frequency") is None
