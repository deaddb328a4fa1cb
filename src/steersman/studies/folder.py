"""The folder of a study holds its configuration, so that no other study goes on in it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath

from steersman.config import Settings, build, dump, read_yaml, to_yaml
from steersman.errors import ConfigError
from steersman.files import write_text


def same_study(config: Settings, out: FilePath, free: Sequence[str]) -> None:
    """Keep a study's configuration in ``out``, or compare it; only ``free`` fields may differ.

    Raises:
        ConfigError: the folder holds a study of something else.
        DataError: the folder cannot be written.
    """
    file = out / "config.yaml"
    now = dump(config) or {}
    if file.exists():
        # Read as a configuration, so that fields that are new since then have their defaults.
        changed = {name: now[name] for name in free}
        before = dump(build(type(config), read_yaml(file) | changed)) or {}
        for key in now:
            if before.get(key) != now[key]:
                raise ConfigError(f"{out} holds a study with another {key}; give another folder")
    write_text(file, to_yaml(config))
