"""Words of all packages: signals, images, models, ports, errors, settings and angles; imports no other package of treadline.

Contract: each module by its name, such as ``core.signals`` and ``core.models``.
"""
