"""``treadline tune``: LQR gain and observer of an identified model."""

from pathlib import Path
from typing import get_args

from treadline import api
from treadline.cli._arguments import Force, List, choice, claim, numbers
from treadline.cli._output import Answer
from treadline.core.errors import SettingsError


def tune(
    model: Path,
    /,
    *,
    state_weight: List = None,
    output_weight: List = None,
    input_weight: List = None,
    period: float | None = None,
    reconstruct: str = "observer",
    vehicle: str | None = None,
    accept_poor_fit: bool = False,
    out: Path = Path("controller.json"),
    force: Force = False,
) -> Answer:
    """Compute the LQR gain (Eq. 10) and the observer for an identified model.

    Args:
        model: Model file (JSON) that treadline identify wrote.
        state_weight: Diagonal of Q on the states, as in Eq. (13): 1,1. The basis of the states is the model's own, which identify
            leaves open: for the paper's weights give identify --method okid-era.
        output_weight: Diagonal of Q on the outputs instead (heading, yaw rate). Default: 1,0.
        input_weight: Diagonal of R on the inputs, or one number for all. Default: 0.02.
        period: Control period in seconds, a multiple of 0.01. Default: the model's; another period resamples the model.
        reconstruct: State reconstruction: observer, or static for Eq. (11b).
        vehicle: Chair that the controller is for: the name of a shipped chair, or a chair file. Another chair rejects it. Default:
            the chair that drove, where the log says so; else wheelchair.
        accept_poor_fit: Tune a model of which identify says that it explains less than half of each output's variance.
        out: Controller file to write. Default: controller.json.
    """
    from treadline.control import closed_loop_poles
    from treadline.control.tune import design_warning
    from treadline.core.models import Reconstruct

    chosen = choice("--reconstruct", reconstruct, get_args(Reconstruct))
    if state_weight is not None and output_weight is not None:
        raise SettingsError("give --state-weight or --output-weight, not both")
    if out.resolve() == model.resolve():
        raise SettingsError(f"--out {out}: is the model itself; a controller would be written over it: give another")
    claim(out, force=force, kind="file")
    loaded = api.load_model(model)
    chair = None if vehicle is None else _name_of(vehicle)
    controller = api.tune(
        loaded,
        state_weight=numbers("--state-weight", state_weight),
        output_weight=numbers("--output-weight", output_weight),
        input_weight=numbers("--input-weight", input_weight),
        period_s=period,
        reconstruct=chosen,
        vehicle=chair,
        accept_poor_fit=accept_poor_fit,
    )
    controller.save(out)
    warning = design_warning(controller)
    poles = closed_loop_poles(controller)
    radius = max(abs(pole) for pole in poles)
    return Answer(
        values={
            "K": controller.K,
            "closed_loop_poles": [[pole.real, pole.imag] for pole in poles],
            "period_s": controller.period_s,
            "spectral_radius": radius,
            "controller": str(out),
            "warnings": [] if warning is None else [warning],
        },
        summary=[
            f"K = {controller.K.round(4).tolist()}",
            f"spectral radius {radius:.3f} at a period of {controller.period_s:g} s; "
            f"made for {controller.vehicle}, written to {out}",
            *([] if warning is None else [f"warning: {warning}"]),
        ],
    )


def _name_of(vehicle: str) -> str:
    """Return the name of a shipped chair, or of that in a file."""
    from treadline.scenario.chair import read_chair

    try:
        return read_chair(vehicle).name
    except SettingsError as error:
        raise SettingsError(f"--vehicle: {error}") from None
