"""What MkDocs calls while it builds the manual: pages and pictures that are made from the package itself."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))  # MkDocs loads this file alone

import commands
import effects
import presets
import reference
from mkdocs.structure.files import File


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages and pictures to what stands in the folder."""
    root = Path(config["config_file_path"]).parent
    for made in (effects.pages(root), reference.pages(), commands.pages(), presets.pages()):
        for name, text in made.items():
            files.append(File.generated(config, name, content=text))
    for name, picture in effects.pictures(root).items():
        files.append(File.generated(config, name, content=picture.read_bytes()))
    return files
