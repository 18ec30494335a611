"""The motor model of every virtual drive."""

import math

import pytest

from drivecomm.protocol import Command, Motor


@pytest.fixture
def motor():
    return Motor()


def test_motor_at_rest_has_zero_outputs(motor):
    motor.advance(100.0)
    assert not motor.running
    assert (motor.output_hz, motor.shaft_hz, motor.current_a, motor.voltage_v, motor.power_kw) == (0, 0, 0, 0, 0)
    assert motor.torque_percent == 0
    assert motor.dc_link_v == pytest.approx(400 * math.sqrt(2))
    assert not motor.at_reference
    assert not motor.accelerating
    assert not motor.decelerating


def test_motor_ramps_up_to_the_reference_and_stays(motor):
    motor.run(25.0, 0.0)
    motor.advance(1.0)
    assert motor.output_hz == pytest.approx(10.0)
    assert motor.accelerating
    assert not motor.at_reference
    motor.advance(2.5)
    assert motor.output_hz == pytest.approx(25.0)
    motor.advance(60.0)
    assert motor.output_hz == 25.0
    assert motor.at_reference
    assert not motor.accelerating
    assert motor.speed_rpm == pytest.approx(725.0)
    assert motor.voltage_v == pytest.approx(200.0)
    assert motor.power_kw == pytest.approx(4.0 * 0.6 / 2)
    assert motor.torque_percent == pytest.approx(60.0)
    assert 0 < motor.current_a < motor.rated_a
    assert motor.running_s == pytest.approx(60.0)
    assert motor.energy_kwh == pytest.approx(1.2 * 60 / 3600, rel=0.1)


def test_many_small_time_steps_give_the_same_speed_as_one():
    together, apart = Motor(), Motor()
    for motor in (together, apart):
        motor.run(40.0, 0.0)
        motor.advance(3.0)
        motor.run(-20.0, 3.0)
    together.advance(6.5)
    for step in range(1, 351):
        apart.advance(3.0 + step / 100)
    assert together.output_hz == pytest.approx(apart.output_hz)


def test_earlier_time_does_not_change_the_motor(motor):
    motor.run(50.0, 10.0)
    motor.advance(11.0)
    before = motor.output_hz
    motor.advance(5.0)
    motor.advance(11.0)
    assert motor.output_hz == before


def test_motor_slows_down_to_a_lower_reference(motor):
    motor.run(50.0, 0.0)
    motor.advance(5.0)
    motor.run(30.0, 5.0)
    motor.advance(6.0)
    assert motor.output_hz == pytest.approx(40.0)
    assert motor.decelerating
    assert motor.dc_link_v > 400 * math.sqrt(2)
    motor.advance(20.0)
    assert motor.at_reference


def test_motor_reverses_through_zero(motor):
    motor.run(20.0, 0.0)
    motor.advance(2.0)
    motor.run(-20.0, 2.0)
    motor.advance(3.0)
    assert motor.output_hz == pytest.approx(10.0)
    motor.advance(5.0)
    assert motor.output_hz == pytest.approx(-10.0)
    motor.advance(10.0)
    assert motor.output_hz == -20.0
    assert motor.torque_percent == pytest.approx(-60.0)


def test_reference_is_limited_to_the_maximum_frequency(motor):
    motor.run(80.0, 0.0)
    assert motor.target_hz == 50.0
    motor.run(-80.0, 0.0)
    assert motor.target_hz == -50.0


def test_ramps_of_zero_seconds_are_steps():
    motor = Motor(ramp_up_s=0.0, ramp_down_s=0.0)
    motor.run(50.0, 0.0)
    motor.advance(0.001)
    assert motor.output_hz == 50.0
    motor.run(-50.0, 0.001)
    motor.advance(0.002)
    assert motor.output_hz == -50.0


@pytest.mark.parametrize(
    ("how", "seconds"), [(Command.RAMP_STOP, 5.0), (Command.QUICK_STOP, 1.0), (Command.DC_BRAKE, 1.0)]
)
def test_stop_takes_the_time_of_its_kind(motor, how, seconds):
    motor.run(50.0, 0.0)
    motor.advance(5.0)
    motor.stop(how, 5.0)
    motor.advance(5.0 + seconds * 0.9)
    assert motor.running
    assert 0 < motor.output_hz < 50.0
    assert motor.decelerating
    motor.advance(5.0 + seconds * 1.01)
    assert not motor.running
    assert motor.output_hz == 0


def test_shaft_turns_on_after_coasting_begins(motor):
    motor.run(50.0, 0.0)
    motor.advance(5.0)
    motor.stop(Command.OFF, 5.0)
    assert motor.output_hz == 0
    motor.advance(6.0)
    assert 0 < motor.shaft_hz < 50.0
    assert not motor.running
    motor.advance(9.0)
    assert motor.shaft_hz == 0


def test_hold_keeps_the_output_frequency(motor):
    motor.run(50.0, 0.0)
    motor.advance(2.0)
    motor.stop(Command.HOLD, 2.0)
    motor.advance(10.0)
    assert motor.output_hz == pytest.approx(20.0)
    assert motor.running
    assert not motor.decelerating


def test_ramp_stop_leaves_a_motor_that_is_off_unchanged(motor):
    motor.stop(Command.RAMP_STOP, 1.0)
    assert motor.command is Command.OFF


def test_trip_switches_the_motor_off_until_a_reset(motor):
    motor.run(50.0, 0.0)
    motor.advance(2.0)
    motor.trip(14, 2.0)
    assert motor.fault == 14
    assert not motor.running
    motor.run(50.0, 3.0)
    assert not motor.running
    motor.reset(4.0)
    assert motor.fault == 0
    assert not motor.running
    motor.run(50.0, 5.0)
    assert motor.running


def test_trip_with_fault_code_zero_is_refused(motor):
    with pytest.raises(ValueError, match="fault code 0 means no fault"):
        motor.trip(0, 1.0)


def test_motor_warms_up_and_cools_down(motor):
    motor.run(50.0, 0.0)
    motor.advance(600.0)
    warm = motor.temperature_c
    assert warm > 40
    motor.stop(Command.OFF, 600.0)
    motor.advance(3600.0)
    assert motor.temperature_c < warm
