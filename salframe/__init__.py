"""salframe: indoor localization from a single RGB-D panorama with 360-degree saliency graphs.

The names that this module exports are the public API. Everything else may change without notice. A name is imported
when it is first used. The file __init__.pyi lists the names and their modules.
"""

import os
import sys

import lazy_loader

_root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
if os.path.isfile(os.path.join(_root, "pyproject.toml")):
    # In a clone of the repository: prefer its plugins to those of an installed version.
    _folders = [os.path.join(_root, name) for name in ("plugins", "baselines")]
    sys.path[:0] = [folder for folder in _folders if folder not in sys.path]

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
