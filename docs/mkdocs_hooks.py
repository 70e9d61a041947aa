# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""What the pages need to be a site as well as Markdown on a code host."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

OUTWARD = re.compile(r"(?<!!)\[([^\]]+)\]\(((?:\.\./)+[^)#\s]+)(?:#[^)\s]*)?\)")
"""A link that leads up, and so perhaps out of docs/."""


def on_page_markdown(markdown: str, *, page: Any, config: Any, files: Any) -> str:
    """Name the files of the source tree that a page links to: the site does not have them.

    A link to a file that is not there stays, and MkDocs warns of it.
    """
    docs = Path(config["docs_dir"]).resolve()
    here = (docs / page.file.src_uri).parent

    def name(link: re.Match[str]) -> str:
        target = (here / link[2]).resolve()
        if target.is_relative_to(docs) or not target.exists():
            return link[0]
        label = link[1]
        path = f"`{target.relative_to(docs.parent)}`"
        return path if label.strip("`") == path.strip("`") else f"{label} ({path})"

    return OUTWARD.sub(name, markdown)
