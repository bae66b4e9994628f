"""Emulated chairs: MuJoCo behind a serial line or a CAN bus, each in a process of its own, with the firmware in C inside.

Contract: ``python -m treadline.hardware.emulators``.
"""
