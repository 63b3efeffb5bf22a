"""The README as package indexes show it: without pictures that lie in the source alone."""

import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface


class CustomMetadataHook(MetadataHookInterface):
    """Hatchling finds it by its name."""

    def update(self, metadata: dict) -> None:
        """Set the README of the package."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n*(\*[^\n]*\*\n\n)?", "", text)  # a caption as well
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
