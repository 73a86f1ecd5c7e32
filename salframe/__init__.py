"""salframe: where am I, and which way do I turn? Localization from one RGB-D panorama by 360-degree saliency graphs.

What this module exports is promised, nothing else is. A name is imported when it is first used: __init__.pyi says from
where.
"""

import os
import sys

import lazy_loader

_root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
if os.path.isfile(os.path.join(_root, "pyproject.toml")):
    # A clone: use its own plugins, not those of a version that is installed besides.
    _folders = [os.path.join(_root, name) for name in ("plugins", "baselines")]
    sys.path[:0] = [folder for folder in _folders if folder not in sys.path]

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
