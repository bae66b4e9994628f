"""Time stamps: each kind of reading has a clock of its own, which goes on, and not by leaps (row 10)."""

import math


class Stamps:
    """The last stamp of each kind."""

    def __init__(self, leap_s: float) -> None:
        self._leap_s = leap_s
        self._last_s: dict[str, float] = {}
        self.leap: str | None = None
        """How the last stamp leapt, if it did."""

    def admit(self, kind: str, t_s: float, now_s: float) -> bool:
        """Say whether a stamp is newer than the last of its kind, and near enough to both clocks."""
        self.leap = None
        last_s = self._last_s.get(kind, -math.inf)
        if t_s - now_s > self._leap_s:
            self.leap = f"clock of {kind} leapt {t_s - now_s:.2f} s ahead"
            return False
        if last_s - t_s > self._leap_s:
            # What comes later is compared with the new time: a person may re-arm.
            self._last_s[kind] = t_s
            self.leap = f"clock of {kind} leapt {last_s - t_s:.2f} s back"
            return False
        if not (math.isfinite(t_s) and t_s > last_s):
            return False
        self._last_s[kind] = t_s
        return True


class Silence:
    """When each of several sources was last heard; one that has never spoken is not waited for."""

    def __init__(self, timeout_s: float, what: str) -> None:
        self._timeout_s = timeout_s
        self._what = what
        self._heard_s: dict[str, float] = {}

    def heard(self, source: str, t_s: float) -> None:
        """Note a sign of life."""
        self._heard_s[source] = max(t_s, self._heard_s.get(source, t_s))

    def cause(self, t_s: float) -> str | None:
        """Return which source has been silent for too long, or None; what it said of the future was said now."""
        for source, heard_s in self._heard_s.items():
            self._heard_s[source] = min(heard_s, t_s)
            if t_s - heard_s > self._timeout_s:
                return f"{self._what}{source} silent for {t_s - heard_s:.2f} s"
        return None

    def restart(self, t_s: float) -> None:
        """Wait for each anew."""
        self._heard_s = dict.fromkeys(self._heard_s, t_s)
