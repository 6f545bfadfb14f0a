"""The table of modalities: complete, and kind to what it does not know."""

import pytest
from sense4hri.modalities import MODALITIES, check_unit, modality, style_sheet
from sense4hri.names import SENSOR_TYPES, StreamName


def test_it_holds_the_sensor_types_of_the_contract():
    """Nine signals and four helpers, and no helper is missed where nobody interprets it."""
    assert len(SENSOR_TYPES) == 13
    assert {name for name, entry in MODALITIES.items() if entry.helper} == {
        "accelerometer",
        "gyroscope",
        "magnetometer",
        "temperature",
    }
    assert all(entry.message for entry in MODALITIES.values() if not entry.helper)


def test_every_colour_is_given_for_both_themes():
    """The style sheet defines every type once on dark and once on light, and a colour for the others."""
    sheet = style_sheet()
    for name in (*MODALITIES, "other"):
        assert sheet.count(f"--{name}: #") == 2, name


def test_a_type_that_the_table_does_not_know_is_no_error():
    """A third party's type has a topic, a label, no features, and any unit."""
    assert StreamName.parse("/humans/physiological/p1/hand_flexion/g_1/raw") is not None
    assert modality("hand_flexion").label == "hand flexion"
    assert modality("hand_flexion").message == ""
    check_unit("hand_flexion", "parsec")


@pytest.mark.parametrize(
    ("sensor_type", "unit"), [("ecg", "uV"), ("eye_tracking", "px"), ("respiration", "N"), ("ecg", "counts")]
)
def test_canonical_units_and_those_without_a_scale_are_taken(sensor_type, unit):
    """The contract's unit, or one that says that no scale is known."""
    check_unit(sensor_type, unit)


def test_another_unit_is_named_with_what_is_allowed():
    """Millivolts of an ECG would be a thousand times too small for everybody."""
    with pytest.raises(ValueError, match=r"'mV' of ecg: the canonical unit is uV"):
        check_unit("ecg", "mV")
