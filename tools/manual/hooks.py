"""What MkDocs calls while it builds the manual: pages and pictures that are made from the package itself."""

import sys
from pathlib import Path
from typing import Any

# MkDocs loads this file alone; the pictures of the effects belong to the studies.
sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
sys.path.insert(0, str(Path(__file__).parent))

import api
import commands
import effects
import presets
import reference
from mkdocs.structure.files import File

_ELSEWHERE = "https://unpkg.com/iframe-worker/shim"  # what the plugin `offline` makes each page ask for


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """Search in a page that is opened from a folder, by a script of our own: nothing is fetched from elsewhere."""
    ours = f"{'../' * page.url.count('/')}search-from-a-folder.js"
    if _ELSEWHERE not in output:
        raise ValueError(f"{page.url} does not ask for {_ELSEWHERE}: is search-from-a-folder.js needed still?")
    return output.replace(_ELSEWHERE, ours)


def on_post_template(output_content: str, template_name: str, **_: Any) -> str:
    """The page for what is not there, which has no search from a folder."""
    return output_content.replace(f'<script src="{_ELSEWHERE}"></script>', "")


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages and pictures to what stands in the folder."""
    root = Path(config["config_file_path"]).parent
    for made in (effects.pages(root), reference.pages(), commands.pages(), api.pages(), presets.pages()):
        for name, text in made.items():
            files.append(File.generated(config, name, content=text))
    for name, picture in effects.pictures(root).items():
        files.append(File.generated(config, name, content=picture.read_bytes()))
    return files
