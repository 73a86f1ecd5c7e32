"""salframe: where am I, and which way do I turn? Localization from one RGB-D panorama by 360-degree saliency graphs.

What this module exports is promised, nothing else is. A name is imported when it is first used: __init__.pyi says from
where.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
