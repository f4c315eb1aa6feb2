"""Every sentence that a person reads of a result, a table for each kind of result; ``{...}`` stands for its numbers."""

from __future__ import annotations

from collections.abc import Sequence

BEYOND = {
    "note": "the command leaves what the twin knows: {axes}",
    "axis": "{axis} at {places} {unit} ({share:.0%} of the time), expect an effort error of {error:.3g} {effort} there",
}

LOG = {  # what `check` says of a log: code -> sentence
    # the clock
    "clock_missing": "no time channel; map its column, or give `t: {{rate: ...}}`, under columns in machine.yaml",
    "clock_holes": "{count} stamps are missing; the log is cut there",
    "clock_stands": "{why}",
    "clock_unit": "{why}",
    "log_short": "lasts {seconds:.2g} s: no axis goes to and fro in that; record longer, a few seconds at least",
    "clock_backward": "the clock runs backward {count} times, first at row {first}; the log is cut there, "
    "check the logger's clock",
    "clock_duplicated": "{count} duplicated time stamps, first at row {first} (about {rate:.4g} Hz); the "
    "log is cut there, resample it or log finer stamps",
    "clock_gaps": "{count} gaps, {missing} samples missing at about {rate:.4g} Hz, the longest "
    "{longest:.4g} s{jump}, first at row {first}; single samples are bridged, the log is cut at longer holes",
    "clock_jitter": "irregular sampling: interval {step:.4g} ms, jitter {rms:.3g} ms rms, {most:.3g} ms at "
    "most; preparation takes the clock that the motion shows",
    "clock_odd": "rows come every {step:.5g} ms: if the controller's cycle is {cycle:.4g} ms, the clock runs "
    "{off:+.2g} % off, and so do speeds; an inertia is then off by twice that",
    "slow_rate": "{rate:.4g} Hz is too slow to identify inertia: a servo accelerates within 10 to 100 ms; "
    "friction and gravity can be found, log at 250 Hz or more for the rest",
    # one channel
    "empty": "holds no number at all; drop it from columns or log it",
    "missing": "{count} values missing, first in row {first}; the log is cut there",
    "always_zero": "is always zero{remedy}",
    "constant": "is constant at {value:.6g}",
    "coarse_position": "resolves {step:.3g}: only {steps:.0f} steps over its whole range, speed and "
    "acceleration from it are coarse; log with more digits",
    "saturated": "saturated at {low:.4g} or {high:.4g} in {percent:.2g} % of the rows; these rows say "
    "nothing about the plant; move less violently",
    "few_digits": "{names}: numbers have {digits} significant digits, so the resolution falls as they grow; "
    "export with more digits",
    # rows
    "stale_rows": "{count} of {rows} rows repeat the row before in every measured channel: the log is "
    "sampled faster than the controller renews its values; log at its rate",
    "copied_rows": "{count} of {rows} rows are exact copies of other rows in all {channels} measured "
    "channels: sentinel or replayed rows, leave them out{key}",
    "sentinel": "jumps to {value:.6g} (as in the file) and back {times} times: a sentinel value; leave the "
    "{rows} rows with it out{key}",
    "effort_sentinel": "is {value:.6g} (as in the file) in {rows} rows, far beyond all others: a sentinel "
    "value; leave these rows out{key}",
    "spikes": "stands apart from the rows before and after in {count} rows, first {first}: lost or garbled "
    "values; leave these rows out{key}",
    "wraps": "wraps around {count} times, first at row {first}; give columns.{name} the counter's range (as "
    "in the file), {range}, in machine.yaml: then it is unwrapped",
    "leaps": "leaps in {count} rows, first {first}, by up to {size:.4g} (as in the file), and moves on as "
    "before: rows are missing there or its counter was set anew, and no speed can be had across them; log a "
    "time channel (then the log is cut there) or without pauses",
    "bad_state": "{percent:.0f} % of the untrustworthy rows have {name} = {value:g}; leave all {rows} rows "
    "with that value out (data: {{leave_out: [{{{name}: {value:g}}}]}})",
    "rows_lost": "{count} rows are missing at {places} places, first at {first:.4g} s, though the clock is even: "
    "every axis steps by several samples at once; record again without loss",
    "rows_doubled": "{count} rows repeat the row before in every channel, first at {first:.4g} s: they were recorded "
    "twice; leave them out or record again",
    "rows_held": "each measurement is held for {count} rows while the command moves on: the log is sampled faster than "
    "the drive answers; log at its rate",
    "interpolated": "{percent:.0f} % of the rows lie on lines between others: drawn from a slower log; use that one",
    "command_jitter": "its steps scatter by {percent:.2g} % from row to row: the set points are made, sent or stamped "
    "on a clock that jitters; give them an even one",
    "frozen": "stands still from {start:.4g} to {end:.4g} s while the axis moves: the channel froze; leave that "
    "stretch out (data: leave_out in machine.yaml)",
    # the axes
    "position_missing": "no position {axis}.q; map it under columns in machine.yaml, or take the axis out "
    "of axes; {hint}",
    "effort_missing": "no effort {axis}.u: its parameters cannot be identified; log it",
    "axis_still": "does not move: nothing of it can be identified",
    "no_motion": "no axis moves; record a motion",
    "position_unit": "reaches {far:.4g} {unit}: looks like {other}, set unit: {other} under columns in "
    "machine.yaml if so",
    "position_limit": "ranges from {low:.4g} to {high:.4g}, outside the URDF's limits {least:.4g} to "
    "{most:.4g}: check unit and zero under columns in machine.yaml",
    "speed_limit": "reaches the speed {speed:.4g}, above the URDF's limit {limit:.4g}",
    "effort_limit": "reaches {top:.4g}, above the URDF's limit {limit:.4g}: check its factor",
    "effort_lead": "effort {how} the position by about {usual:.1f} ms (by axis: {each}): the channels are "
    "not taken at the same instant; `identify` finds such a lead and says so, or state it in machine.yaml "
    "(axes.{axis}: `lead: {lead:.1f} ms`)",
    "loop_unstable": "swings {rate:.0f} times a second between its largest efforts either way, unasked by the command: "
    "its loop is unstable; lower its gains, or leave those seconds out (data: leave_out in machine.yaml)",
    "loop_hunts": "swings by {size:.3g} {unit} either way at {rate:.3g} Hz about a command that stands, from "
    "{start:.4g} to {end:.4g} s, {total:.3g} s in all: its loop hunts; lower its gains, look for play and for "
    "an integrator against dry friction, or leave those seconds out (data: leave_out in machine.yaml)",
    "command_is_position": "holds the same numbers as {axis}.qr: a command was logged twice; map the measured position",
    "velocity_disagrees": "the position changes {ratio:.4g} times as fast as this velocity says: check both units",
    "command_late": "comes {ms:.3g} ms ({rows} rows) late: the controller acts on it before it is in the log; log "
    "command and position of one instant",
    "command_disagrees": "command and position do not agree{times}; another unit, sign or axis? check columns",
    "position_scale": "goes {factor:.4g} times as far as its command, where it rests: another gear, lead or "
    "unit? set factor under columns in machine.yaml",
    "load_constant": "is constant: no encoder at the load? drop it from columns",
    "slipped": "rests off its command {words}, wherever it is: steps are lost, something slipped, or its load "
    "changed; find what gives way, and home the axis again",
    "motor_turns_several": "does not go with {axis}.q: its motor turns several joints; write "
    "transmission: {{{axis}: {{{row}}}}} in machine.yaml",
    "load_position": "at the load against the motor: offset {offset:.4g} {unit}, difference {rms:.3g} "
    "{unit} rms, lost motion between the directions {lost:.3g} {unit}, correlation {correlation:.7f}{remedy}",
    # the efforts
    "effort_stands": "stands at {level:.3g} {unit} while the axis moves both ways: a drive at its limit all "
    "along, or no effort of this axis",
    "effort_noise": "is noise: it has no memory and nothing of the motion in it; log the motor's effort",
    "effort_strange": "fits this motion no better than if it were of another time: it is of another run or axis",
    "effort_unsigned": "never changes its sign, but fits the motion with a sign that changes where it "
    "touches zero: a magnitude was logged; log the signed effort",
    "effort_weightless": "holds none of the weight that the URDF's masses have: the controller took it out, a "
    "counterweight carries it, or it is in another unit; log the motor's whole effort",
    "effort_frictionless": "holds no friction: a model of the drive gave it, or a torque sensor behind the gear; "
    "a twin of it has none either, log the motor's effort",
    "effort_late": "comes {ms:.0f} ms late for the motion, more than any drive: the channels are not of one "
    "instant; log them together, or shift this column before use",
    "effort_early": "comes {ms:.0f} ms early for the motion, more than any drive: the channels are not of "
    "one instant; log them together, or shift this column before use",
    "effort_sign": "the effort {whose} has the wrong sign: friction would drive the motion; give its column "
    "in machine.yaml a negative factor (or those of the position, if that is what is reversed)",
    "effort_scale": "is {times} for the URDF's masses. Check the masses, and unit and factor under columns "
    "in machine.yaml",
    "effort_unit": "in {unit} (no factor under columns): `identify` finds what one is in N or N·m from the "
    "URDF's masses; give the factor (torque constant x gear) if you know it",
    "effort_exchanged": "the effort of {a} fits the motion of {b} and vice versa: exchange their "
    "columns in machine.yaml (or those of their positions)",
    "position_exchanged": "with the positions of {a} and {b} exchanged the efforts of the machine fit: "
    "exchange the columns of position and command in machine.yaml",
    "position_sign": "with the position of {a} reversed the efforts of the machine fit: give the columns of "
    "its position and command in machine.yaml a negative factor",
    # the machine, and what a log excites of it
    "body_impossible": "what it moves cannot exist: {problem}; `identify` starts from a body that can, correct "
    "the <inertial> of its links",
    "body_oversized": "its mass would be {radius:.3g} m away from its centre, in a machine of {size:.2g} m: an inertia "
    "in a CAD program's units? `identify` starts from a rod, give the <inertial> in kg·m²",
    "joint_free": "leaves the base free in the URDF; locked here, as if the machine stood on the ground",
    "joint_mimics": "follows {leader} in the URDF (mimic); held at zero here",
    "link_massless": "link of a moving joint without <inertial>: its mass counts as zero",
    "no_effect": "{count} inertial parameters have no effect on any joint torque: {names}",
    "urdf_invalid": "URDF: {problems}",
    "unusable": "{why}",
    "not_excited": "{names}: this log does not excite it; move the axes that carry it harder",
    "not_separable": "not separable on this log: {names}",
    "identifiable": "{count} of {of} base parameters can be identified, condition {condition:.3g}",
    "not_tried": "what this motion could not reveal is not tried on more than {most} axes",
    "not_told": "this motion could not reveal {what}. To check, move these axes faster and alone",
}

IDENTIFIED = {  # what the page of `identify` says first, and to be careful about
    "unjudged": "This twin carries no judgement of itself: it was not identified from a log.",
    "unit_URDF": "{axis}: 1 {unit} is {size:.3g} {effort} ({ends[0]:.3g} to {ends[1]:.3g}) by the URDF's masses",
    "unit_given": "{axis}: 1 {unit} is {size:.3g} {effort} ({ends[0]:.3g} to {ends[1]:.3g}) by other axes' factors",
    "unit_rod": "{axis}: the effort is in {unit} of unknown size; masses and {effort} are guesses",
    "on_load": "{axis}: its law fits better with the position at the load; give loop: {{{axis}: {{closed_on: load}}}}",
    "short": "The log is too short to judge the twin on data that were not fitted.",
    "one": "{where}, the twin predicts the motor effort of {worst} to {size}.",
    "several": "{where}, the twin predicts the motor effort {said}. The largest error is on {worst}: {size}.",
    "size": "{share} of its standard deviation ({rms} RMS)",
    "command": "From the command alone it predicts the effort {effort} (error {of_effort} of its RMS), the tracking "
    "error {tracking} ({of_tracking}). This was judged on the last part of the log.",
    "validation": "On the validation log",
    "held_out": "Cross-validated on the log",
    "tile": "{rms} RMS · {share} of the RMS effort · in the fit {fit}",
    "open": "{open} of {all} parameters are not determined by these data ({names}). Predictions of other motions "
    "that need them rely on the URDF.",
    "coloured": "The residual of {axes} is not white: it has a systematic part, which the intervals below allow for. "
    "Run pinotwin diagnose to find the cause.",
}
ADVERBS = {  # grade of a twin's error -> how it predicts, the best first
    "very good": "very well",
    "good": "well",
    "fair": "fairly",
    "poor": "poorly",
    "not judged": "unjudged",
}

SIMULATED = {  # what the page of `simulate` says first
    "alone": "The log holds the command alone, so there is nothing to hold the prediction against.",
    "errors": "RMS error of the {signal}, over its RMS: {sizes}.",
    "far": "Much larger error than in validation: {signals}. Run pinotwin diagnose.",
}

SIMULATED_GRADES = {  # grade of a simulated signal -> colour of its chip, and what it says
    "within misfit": ("good", "no larger than the simulation error on held-out data of the twin"),
    "above misfit": ("fair", "above that error, as on a motion unlike those of the twin's data"),
    "far above misfit": ("bad", "the machine has changed, or the motion is outside the twin's data"),
    "not judged": ("", "nothing was measured, or there is no validation error to compare with"),
}
LOOPS = {  # form of a closed loop -> its name
    "coupled": "identified controllers around the identified plant",
    "black": "identified transfer functions",
    "vibration": "transfer functions with the vibration of the passive joint",
}
SERVOS = {  # form of a controller -> its name
    "cascade": "position P around velocity PI",
    "pid": "position PID",
    "proportional": "cascade without an integral",
    "general": "cascade with a set-point weight",
}
JUDGED = {  # what a diagnosis of change says first
    "recording": "The recording is at fault: {faults}. Repair it and diagnose again",
    "changed": "Has changed: {causes}",
    "course": "On {axis} {words}",
    "unknown": "Something has changed that no known cause explains for certain{words}",
    "possible": "Possible, not sure: {causes}",
    "none": "No change found",
    "others": "The other logs show none of it. Judged: {logs}",
    "lacked": "the residual of {axis} in the twin's logs repeats with position ({share:.0%} of it): add the missing "
    "effect with pinotwin improve",
}
AGAINST = {  # under a plot of what is left
    "velocity": "Line: median. A curve is friction that the model does not have.",
    "position": "Line: median. A wave is ripple, cable or guideway.",
}
BLIND = {  # what the page of `blind` says first
    "few": "Too few cases for any score.",
    "all": "All {count} scores reach what they must.",
    "missed": "{reached} of {count} scores reach what they must; missed: {names}.",
}

DIAGNOSED = {  # what the page of `diagnose` says first; under a grade, what is said of an axis with it
    "agree_change": "Log and twin agree: no change found.",
    "agree_structure": "Log and model agree: no missing effect found.",
    "unsure": "Log and {reference} differ on {where}; no cause is certain enough to be named.",
    "unknown": "Log and {reference} differ on {where}, and no known effect explains the residual.",
    "unjudged": "No change found; {where} cannot be judged from these logs.",
    "also": "Also found: {others}.",
    "possible": "Possible, but not sure: {names}.",
    "missing": "is missing from the model",
    "factor": "amounts",
    "hint": "Modelling it does not reduce the residual yet ({data}): a hint only.",
    "falls": "{modelled} {residual} falls from {before} to {after} RMS ({data}).",
    "gain": ", from {before:.3g} to {after:.3g} 1/s",
    "residual": "the residual",
    "signal": "the residual of the {signal}",
    "alone": "With it alone modelled",
    "all": "With all causes modelled",
    "modelled": "With it modelled",
    "not explained": "{axis}: no named cause explains the residual of {rms} RMS.{looks}",
    "pattern": "{axis}: the residual of {rms} RMS is no larger than expected, but healthy logs have no such pattern."
    "{looks}",
    "partly explained": "{axis}: {after} of {rms} RMS remain unexplained.{looks}",
    "not judged": "Axis {axis} is not judged: {why}.",
    "above misfit": "{axis}: the residual is {times:.2g} times the twin's expected error. Watch it.",
    "recording": "The recording is at fault: {faults}. Repair it and diagnose again; no cause is named before that.",
    "tracking": "The tracking error of {axes} is predicted worse than in validation, although the effort agrees; no "
    "cause of that is known.",
    "tracking left": "This does not explain all of the tracking error of {axes}.",
    "again": " and at other times",
    "logged": " In the log's unit: {was} to {now} {unit}. By the URDF's masses 1 {of} is {size:.3g} {effort} "
    "({ends[0]:.3g} to {ends[1]:.3g}); a weighed mass or the factor would settle it.",
}

CHANGED = {"times": "to {after} times its value", "from": "from {before} to {after}"}

SCREEN = {
    "sure": "{sure:.0%} for {cause}",
    "rival": "; next: {rival}, {chance:.0%}",
    "alike": " or what looks alike in this motion: {others}",
    "agrees": "Relative to what is expected, {axis} deviates most: {rms} RMS, {expected} expected.",
    "open": "{axis}: residual of the {signal} {rms} RMS, {expected} expected; no cause is sure enough to be named.",
    "unjudged": "{axis}: residual of the {signal} {rms} RMS; what to expect is not known.",
    "logs": "{logs}{valid}; compared with {reference}.",
    "valid": ", validated on {logs}",
    "twin": "the twin identified from {logs}",
    "model": "the machine's model, fitted to them",
    "keep": "Nothing needs repair. Keep this log as a reference for later ones.",
    "again": "Record the motion again to confirm the finding.",
    "picture": "Axis {axis}: motor effort where the difference is largest",
    "stretch": "{start:.4g} to {end:.4g} s of {log}; below, measured minus predicted.",
}
"""The first screen of the page of `diagnose`: how sure, on which data, what to do now, and its picture."""

STATES = {
    "change": {"changed": "changed", "unchanged": "unchanged", "cannot say": "cannot say"},
    "structure": {"changed": "unlike its model", "unchanged": "as its model", "cannot say": "cannot say"},
}
"""Situation -> state of an axis -> the words that people read."""

OTHERWISE = {"none": "chance", "unknown": "a cause in no catalogue"}  # alternatives of a cause

DAYS = {  # what the page of ``diagnose --each`` says of the logs of a twin
    "title": "State of every axis",
    "left": "A residual without a named cause: {logs}.",
    "none": "No change in {logs} logs.",
    "changed": "Changed in {count} of {logs} logs.",
    "since": "{what}: in every log from {log} on.",
    "some": "{what}: in {count} of {logs} logs, first in {log}.",
    "once": "{what}: in {log} alone.",
    "unsaid": "Cannot be judged: {logs}.",
    "lost": "Not diagnosed: {logs}.",
    "numbers": "Numbers that moved",
    "bars": "Bars: 90 % interval. A log without a mark does not show the cause.",
}

LACKING_DAYS = {  # the same of the logs of a machine, where it is another
    "none": "No missing effect in {logs} logs.",
    "changed": "The model lacks an effect in {count} of {logs} logs.",
    "numbers": "Numbers that are missing",
}

MEANING: dict[str, str] = {  # grade of a residual -> what it says
    "agrees": "the residual is no larger than the noise",
    "within misfit": "above the noise, but no larger than the twin's expected error",
    "above misfit": "above the twin's expected error, too little to search for a cause",
    "gap explained": "the named causes reduce the residual to noise and validation error",
    "partly explained": "the named causes explain part of the residual; the rest is above the validation error",
    "not explained": "unlike the residual of healthy logs, and no named cause explains it",
    "not judged": "no noise level or validation error to compare the residual with",
}

PRINTED = {  # code of a grade -> the words that people read, where they are others
    "within misfit": "as in validation",
    "above misfit": "above validation",
    "far above misfit": "far above validation",
    "gap explained": "explained",
}

SIGNALS = {
    "u": "motor effort",
    "e": "tracking error",
    "v": "vibration",
    "ql": "motor against load",
    "law": "controller's law",
}
"""Signal -> its name."""

KINDS = {  # kind of region -> its name in a table
    "time": "time in the log",
    "position": "position",
    "velocity": "speed",
    "acceleration": "acceleration",
    "load": "motor effort",
    "frequency": "frequency",
    "other_axis": "other axis moving",
}
REGIONS = {  # kind of region -> where it lies, in a sentence
    "time": "{span} into the log",
    "position": "between positions {span}",
    "reversal": "around standstill and reversal, slower than {end}",
    "velocity": "at speeds of {span}",
    "backward": "at speeds of {span} (backward)",
    "forward": "at speeds of {span} (forward)",
    "acceleration": "at accelerations of {span}",
    "load": "while the motor gives {span}",
    "slow": "in slow changes, below {end}",
    "frequency": "in vibration at {span}",
    "other_axis": "while axis {other} moves",
}

NUMBERS = {  # name of a number -> what it is
    "viscous.b": "friction coefficient",
    "viscous_asymmetric.b_plus": "friction coefficient forward",
    "viscous_asymmetric.b_minus": "friction coefficient backward",
    "viscous_thermal.b": "friction coefficient when cold",
    "viscous_thermal.b_warm": "friction coefficient lost by warming",
    "coulomb.c": "dry friction",
    "coulomb_asymmetric.c_plus": "dry friction forward",
    "coulomb_asymmetric.c_minus": "dry friction backward",
    "stribeck.s": "extra friction at low speed",
    "presliding.c": "dry friction",
    "presliding.s": "extra friction at low speed",
    "presliding.m": "stiffness share",
    "presliding.d": "damping before sliding",
    "quadratic_drag.b2": "drag coefficient",
    "load_friction.mu": "friction per load",
    "hysteresis.k": "drag of the loop",
    "offset.f0": "constant effort",
    "effort_scale.factor": "logged effort over the model's",
    "delay.seconds": "delay",
    "backlash.share": "share of the load behind the play",
    "drive_flexibility.share": "share of the inertia behind the spring",
    "drive_flexibility.resonance": "resonance",
    "joint_flexibility.resonance": "resonance",
    "drive_flexibility.stiffness": "stiffness",
    "drive_flexibility.damping": "damping",
    "drive_flexibility.rotor": "inertia before the spring",
    "backlash.gap": "lost motion",
    "encoder_error.largest": "largest error along the stroke",
    "joint_flexibility.share": "share of the inertia behind the spring",
    "inertial_coupling.J": "coupled inertia",
    "geometric_error.tilt1": "tilt about the first cross axis",
    "geometric_error.tilt2": "tilt about the second cross axis",
    "feedforward.K_v": "feed-forward of speed",
    "feedforward.K_a": "feed-forward of acceleration",
}

IMPROVED = {  # what `improve` found
    "added": "Added to the model: {added}. The error on the sealed log falls to {ratio:.0%} of that without it.",
    "none": "Nothing was added to the model: {end}.",
    "errors": "u: effort along the measured motion; e: tracking error from the command alone. RMS error over RMS.",
}

STUDIED = {  # what `study` found
    "enough": "{seconds:.3g} s are enough: with more the held-out error stays at {error:.1%} of the effort",
    "more": "the error has not settled; a longer log would help",
    "coupling": "a model for each axis alone multiplies the held-out error by {ratio:.3g} on {axis}",
    "runaway": "a model for each axis alone predicts the effort of {axes} worse than its mean does; not drawn there",
    "without": "without {effect} the RMS error grows from {complete:.3g} to {without:.3g} {unit}",
    "overlay": "the curve explains {share:.0%} of the data's power",
    "errors": "{share:.0%} of the tracking error comes from {cause}",
}


def joined(words: Sequence[str]) -> str:
    """Return ``a, b and c``."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def capital(text: str) -> str:
    """Return a text that begins with a capital letter."""
    return text[:1].upper() + text[1:]


CAUSES = {  # cause that is no effect of a machine file -> title, what it is, and what to do
    "friction_scale": (
        "Friction",
        "all friction of the axis is larger or smaller by one factor",
        "check the preload of bearings, guides and screw, lubrication and wipers",
    ),
    "position_gain": (
        "Position gain",
        "the gain of the position controller is not what it was",
        "compare the drive's parameters with the backup; look for a change of mode or gain set",
    ),
    "integral": (
        "Integral gain (reset time)",
        "the integral of the velocity controller is not what it was",
        "compare the drive's parameters with the backup; look for a change of mode or gain set",
    ),
    "velocity_feedforward": (
        "Velocity feed-forward",
        "the controller adds another share of the commanded speed than it did",
        "compare the drive's parameters with the backup",
    ),
    "acceleration_feedforward": (
        "Acceleration feed-forward",
        "the controller adds another share of the commanded acceleration than it did",
        "compare the drive's parameters with the backup",
    ),
    "dead_band": (
        "Dead band of the controller",
        "the controller does nothing while the axis is near its command",
        "compare the drive's parameters with the backup; look for a worn potentiometer, or a valve with overlap",
    ),
    "zero": (
        "Zero of the joint",
        "the joint stands elsewhere than its encoder says",
        "reference the axis anew; look for a slipped coupling or output",
    ),
    "encoder_step": (
        "Step between motor and load",
        "motor and load moved against each other and stayed so",
        "look for a belt that jumped a tooth, a slipped coupling or a lost reference",
    ),
    "encoder_scale": (
        "Scale of the second encoder",
        "motor and load encoder disagree in proportion to the travel",
        "check screw and scale for warmth, and the compensation tables",
    ),
    "command_late": ("Command recorded late", "", "record command and position by one clock"),
    "command_jitter": ("Set points on a clock that jitters", "", "send the set points on an even clock"),
    "clock_scale": ("Clock at another rate", "", "record the time stamps of the controller"),
    "effort_of_another_run": ("Effort of another run", "", "record the effort with the same trigger"),
    "rows_lost": ("Rows lost", "", "raise the logger's buffer, or log fewer channels"),
    "rows_held": ("Measurements held for several rows", "", "log at the rate of the measurements"),
    "interpolated": ("Lines through a slower log", "", "export the log as it was measured"),
    "frozen": ("Effort that stands still", "", "look for lost telegrams of the drive"),
}
