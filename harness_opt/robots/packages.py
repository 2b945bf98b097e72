"""Where a URDF of an installed Python package lies, and where the meshes may lie that a URDF names."""

from __future__ import annotations

import contextlib
import importlib.metadata
import importlib.util
from collections.abc import Iterator
from pathlib import Path


def package_folders(package: str, rest: str) -> Iterator[Path]:
    """Yield the folders in which a Python package that is installed may have a file whose path there is ``rest``.

    Its own folder, where it can be imported; else whatever folder its distribution put such a file into.
    """
    spec = importlib.util.find_spec(package) if package.isidentifier() else None
    for folder in (spec.submodule_search_locations or ()) if spec is not None else ():
        yield Path(folder)
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        files = importlib.metadata.files(package) or []
        ending = [file for file in files if file.as_posix().endswith(f"/{rest}")]
        for file in sorted(ending, key=lambda one: len(one.parts)):
            yield Path(str(file.locate())).parents[len(Path(rest).parts) - 1]


def mesh_candidates(name: str, urdf: Path) -> Iterator[Path]:
    """Yield where the mesh may lie that a URDF calls ``name``: ``package://PACKAGE/...``, or a path from its folder.

    ROS looks packages up in folders that it is told; here the folders around the URDF stand for these.
    """
    if name.startswith("package://"):
        package, _, rest = name.removeprefix("package://").partition("/")
        for folder in urdf.parents:
            if folder.name == package:
                yield folder / rest
            yield folder / package / rest
    else:
        yield urdf.parent / name.removeprefix("file://")
