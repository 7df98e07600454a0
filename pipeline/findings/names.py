"""Names of a run's files and folders."""

import hashlib
import re
import unicodedata
from pathlib import Path

MANIFEST = "manifest.json"
# Maximum length of a file name that is derived from a text, in characters.
_MAX_NAME = 80
# Names that Windows reserves for devices.
_DEVICES = r"con|prn|aux|nul|com\d|lpt\d"


def output_directory(root: Path, name: str) -> Path:
    """Return the folder in `root` for the files of the scenario called `name`."""
    return root / safe_name(name)


def safe_name(name: str) -> str:
    """Return a file name that every system accepts; different texts give different names.

    Letters and digits of any script, `.`, `_` and `-` stay. If the text had to be changed, or is a
    device name in Windows, the name gets a short hash. At most 80 characters and 240 bytes.
    """
    normal = unicodedata.normalize("NFC", name)
    plain = re.sub(r"[^\w.-]+", "-", normal).strip("-.")[:_MAX_NAME]
    is_device = re.fullmatch(_DEVICES, plain.partition(".")[0], re.IGNORECASE)
    if plain and plain == name and len(plain.encode()) <= 240 and not is_device:
        return plain
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    short = plain.encode()[:64].decode(errors="ignore").strip("-.")
    if is_device:
        return f"{digest}-{short}"
    return f"{short}-{digest}" if short else digest


def season_stem(scenario: str, season: str) -> str:
    """Return the beginning of the names of a season's files: scenario and season."""
    return safe_name(f"{scenario}-{season}")


SCHEMA_VERSION = 1
# An absolute path inside a text, of at least two parts: no address, fraction or tag.
_ABSOLUTE = re.compile(r"(?<![\w/:.])/(?:[^\s/'\"]+/)+([^\s/'\",;]+)")


def without_folders(value: object) -> object:
    """Return a value for JSON in whose texts files are named without their folders."""
    if isinstance(value, str):
        return Path(value).name if Path(value).is_absolute() else _ABSOLUTE.sub(r"\1", value)
    if isinstance(value, dict):
        return {key: without_folders(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [without_folders(one) for one in value]
    return value
