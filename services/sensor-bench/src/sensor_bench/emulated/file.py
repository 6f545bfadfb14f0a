"""An emulator's file, loaded: plain Python that needs nothing of the bench."""

import importlib.util
from pathlib import Path
from types import ModuleType

from sense4hri.errors import ConfigError


def loaded(path: str, *names: str) -> ModuleType:
    """Run the file and return what it defines. Raises ConfigError where it is not there, fails or lacks a name."""
    if not Path(path).is_file():
        raise ConfigError(f"devices: emulator: no such file: {path}")
    spec = importlib.util.spec_from_file_location("emulator", path)
    if spec is None or spec.loader is None:
        raise ConfigError(f"devices: emulator: {path} is no file of Python")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (SyntaxError, ImportError, NameError) as err:
        raise ConfigError(f"devices: emulator: {path}: {err}") from err
    if lacking := [name for name in names if not hasattr(module, name)]:
        raise ConfigError(f"devices: emulator: {path} has no {lacking[0]}")
    return module
