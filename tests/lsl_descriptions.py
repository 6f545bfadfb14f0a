"""XML of LSL streams, as outlets describe themselves."""

TAGS = ("label", "unit", "type")


def xml(kind, channels, rate_hz=250.0, form="float32", name="Amp", more=""):
    """Return a stream's XML; channels: (label, unit, type) each, empty parts left out."""
    described = "".join(f"<channel>{_channel(each)}</channel>" for each in channels)
    return (
        f"<info><name>{name}</name><type>{kind}</type><channel_count>{len(channels)}</channel_count>"
        f"<channel_format>{form}</channel_format><source_id>sn-1</source_id><nominal_srate>{rate_hz}</nominal_srate>"
        f"<hostname>lab-2</hostname><desc>{more}<channels>{described}</channels></desc></info>"
    )


def _channel(parts):
    return "".join(f"<{tag}>{text}</{tag}>" for tag, text in zip(TAGS, parts, strict=True) if text)
