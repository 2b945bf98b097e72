"""Motional cable harness design: shapes, clearances and redesign of cables between moving clamps.

Names are imported when first used, so that ``import harness_opt`` and the commands that solve nothing start at once;
``__init__.pyi`` lists them. No room is called like a public function: importing a room binds its name here.
"""

import lazy_loader

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
