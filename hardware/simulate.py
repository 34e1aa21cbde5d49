"""Simulates the circuit of `valve-board.kicad_sch` in ngspice against the figures of `docs/reference/board.md`.

Each figure of its section "Figures of the circuit" is simulated on the whole netlist, with sensors, coils and the
Pico's pins attached, and may be 1 % off. Exit code 1: one is not met, or the section and this file name different
figures. The models below hold what the data sheets state and no more: `README.md` has the limits.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import schematic

DOCUMENT = Path(__file__).parent.parent / "docs/reference/board.md"
ALLOWED = 0.01
VREF = 3.3
RANGE_PA = 689_476.0

MODELS = """
.model AO3422 VDMOS(nchan Vto=1.3 Kp=20 Rd=80m Rs=20m Rg=1.3 Cgs=200p Cgdmax=100p Cgdmin=12p Cjo=60p Is=1p Bv=60)
.model Si2309CDS VDMOS(pchan Vto=-2 Kp=4 Rd=150m Rs=50m Cgs=180p Cgdmax=60p Cgdmin=15p Cjo=40p Is=1p Bv=65)
* Breakdown in the middle of the data sheet's 36.7 to 40.6 V.
.model SMAJ33A D(Is=1n N=1.6 Rs=0.1 Bv=38.65 Ibv=1m Cjo=300p)
.model PESD5V0 D(Is=1n N=1.6 Bv=7 Ibv=1m Cjo=70p)
.model 1N5819HW D(Is=1u N=1.1 Rs=0.1)
.model LED D(Is=1e-18 N=1.8 Rs=5)
.model contact SW(Vt=0.5 Ron=10m Roff=100meg)
* Gain-bandwidth product 1 MHz with BW at +VS; the output reaches the rails to 20 mV.
.model clamp D(Is=1n N=0.05)
.subckt AD8237 bw inp inn vn vp ref fb out
Gd 0 x cur='1m*(v(inp,inn)-v(fb,ref))'
Rx x 0 100meg
Cx x 0 159.155p
Bh high 0 v='v(vp)-40m'
Bl low 0 v='v(vn)+40m'
Dh x high clamp
Dl low x clamp
Eo out 0 x 0 1
Rb bw vp 10meg
.ends
* Open drain of 50 ohm.
.subckt COMPARATOR out inn inp vn
Bo out vn i='v(out,vn)*10m*(1-tanh(1e4*v(inp,inn)))'
.ends
"""

# Parts at the terminals and pins, by name; a case replaces lines of it. Pt1000 at 298.15 K, potentiometer of
# 5 kohm in the middle, coils of 24 V with 120 ohm and 100 mH (assumed: data sheets do not state it).
OUTSIDE = {
    "supply": "V24 {J1.1} 0 24",
    "usb": "Vusb {VSYS} 0 4.7",
    "pico": "Ragnd {GNDA} 0 1m\nV3v3 {+3V3} 0 3.3\nRrun {RUN_LINE} 0 60k",
    "stop power": "Rs1 {J2.1} {J2.2} 10m",
    "stop sense": "Rs2 {J2.3} {J2.4} 10m",
    "pressure": "Vp {J4.2} {GNDA} 1.65",
    "pressure 2": "Vp2 {J8.2} {GNDA} 1.65",
    "gas": "Rpt {J3.1} {J3.2} 1097.35",
    "length": "Rl1 {J5.1} {J5.2} 2.5k\nRl2 {J5.2} {J5.3} 2.5k",
    "coils": "Rc1 {J6.1} c1 120\nLc1 c1 {J6.2} 0.1\nRc2 {J7.1} c2 120\nLc2 c2 {J7.2} 0.1",
    "valves": "Vg1 {INLET} 0 0\nVg2 {OUTLET} 0 0",
    "fault": "Vf {FAULT} 0 0",
}

PARTS = schematic.read()


def node(name):
    """A net, or a pin such as J1.1, as a name for ngspice."""
    if "." in name and name.split(".")[0] in PARTS:
        reference, pin = name.split(".")
        name = PARTS[reference].pins[pin][1]
    return "0" if name == "GND" else re.sub(r"\W", "_", name)


def value(words):
    """`4.70k 0.1%` or `10 nF` in ohm or farad; M is mega here and milli in ngspice."""
    number, unit = re.match(r"([\d.]+)\s*([kMun]?)", words).groups()
    return float(number) * {"": 1.0, "k": 1e3, "M": 1e6, "u": 1e-6, "n": 1e-9}[unit]


def element(part):
    """Line of a part; terminals and the Pico have none."""
    kind = re.match("[A-Z]+", part.reference)[0]
    at = {number: node(net) for number, (_, net) in part.pins.items()}
    name = part.reference
    if kind in "RC":
        return f"{kind}{name} {at['1']} {at['2']} {value(part.value)}"
    if kind == "F":
        return f"R{name} {at['1']} {at['2']} 0.1"
    if kind == "D" and part.value == "PESD5V0":
        return f"D{name}a {at['1']} {name}m PESD5V0\nD{name}b {at['2']} {name}m PESD5V0"
    if kind == "D":
        model = "LED" if part.value in ("green", "red") else part.value
        return f"D{name} {at['2']} {at['1']} {model}"
    if kind == "Q":
        return f"M{name} {at['3']} {at['1']} {at['2']} {part.value}"
    if part.value == "AD8237":
        return f"X{name} " + " ".join(at[str(pin)] for pin in (1, 2, 3, 4, 5, 6, 7, 8)) + " AD8237"
    if part.value == "MCP6567":
        units = [("1", "2", "3"), ("7", "6", "5")]
        return "\n".join(
            f"X{name}{i} {at[o]} {at[n]} {at[p]} {at['4']} COMPARATOR" for i, (o, n, p) in enumerate(units)
        )
    if part.value == "TPS7A2033PDBV":
        return f"V{name} {at['5']} {at['2']} {VREF}"
    assert kind in "JA", f"{name}: no model of {part.value}"
    return ""


def run(control, **replaced):
    """Runs the netlist and gives what the control lines print, as a dictionary of numbers."""
    outside = OUTSIDE | {key.replace("_", " "): line for key, line in replaced.items()}
    # 1 Gohm to ground, so that a pin without a connection has a voltage.
    open_pins = {node(net) for part in PARTS.values() for _, net in part.pins.values()} - {"0"}
    leaks = (f"Rleak{i} {net} 0 1g" for i, net in enumerate(sorted(open_pins)))
    lines = ["* valve board", MODELS, *map(element, PARTS.values()), *leaks, *outside.values()]
    lines += [".control", control, ".endc", ".end"]
    deck = re.sub(r"\{([^}]+)\}", lambda m: node(m[1]), "\n".join(lines))
    with tempfile.NamedTemporaryFile("w", suffix=".cir") as file:
        file.write(deck)
        file.flush()
        done = subprocess.run(["ngspice", "-b", file.name], capture_output=True, text=True, timeout=60)
    found = {m[1]: float(m[2]) for m in re.finditer(r"^(\w+)\s*=\s*([-+.\deE]+)", done.stdout, re.MULTILINE)}
    if not found:
        sys.exit(f"ngspice gives nothing:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return found


def share(net, **replaced):
    """A converter input in per cent of the reference."""
    return 100.0 * run(f"op\nlet y = v({{{net}}})\nprint y", **replaced)["y"] / VREF


def platinum(kelvin):
    """Pt1000, IEC 60751, in ohm."""
    t = kelvin - 273.15
    below = -4.183e-12 * (t - 100.0) * t**3 if t < 0.0 else 0.0
    return 1000.0 * (1.0 + 3.9083e-3 * t - 5.775e-7 * t * t + below)


def gas(kelvin):
    return f"Rpt {{J3.1}} {{J3.2}} {platinum(kelvin)}"


def at_amplifier(kelvin):
    """Input and output of the amplifier."""
    return run("op\nlet y = v({U1.8})\nlet x = v({U1.2})\nprint y x", gas=gas(kelvin))


def amplifier_gain():
    low, high = at_amplifier(270.0), at_amplifier(330.0)
    return (high["y"] - low["y"]) / (high["x"] - low["x"])


def gas_slope():
    return (share("GAS", gas=gas(298.5)) - share("GAS", gas=gas(297.5))) / 100.0 * VREF * 1e3


def bandwidth(net, **replaced):
    """Frequency at which the signal has lost 3 dB, in kHz."""
    lines = f"ac dec 200 1 1meg\nlet y = db(v({{{net}}}))\nlet y = y - y[0]\nmeas ac f when y=-3.0103"
    return run(lines, **replaced)["f"] / 1e3


def cut_off(rises, level):
    """Share of the reference at which the supply of the valves goes off or comes back, in per cent."""
    start, end = level
    ramp = f"Vp2 {{J8.2}} {{GNDA}} pwl(0 {start * VREF} 1 {end * VREF})"
    edge = "rise" if rises else "fall"
    lines = f"tran 0.1m 1 0 0.1m\nmeas tran p find v({{J8.2}}) when v({{VALVE_24V}})=12 {edge}=1"
    return 100.0 * run(lines, pressure_2=ramp)["p"] / VREF


def pressure(percent):
    """Pressure in kPa that a sensor of 100 psi shows by that share of the reference."""
    return RANGE_PA * (percent / 100.0 - 0.1) / 0.8 / 1e3


PULSE = "Vg1 {INLET} 0 pulse(0 3.3 0 1u 1u 10m 1)\nVg2 {OUTLET} 0 0"
ON = "Vg1 {INLET} 0 3.3\nVg2 {OUTLET} 0 0"
OPENS = "Vs vs 0 pulse(1 0 10m 1u 1u 1 2)\nS1 {J2.1} {J2.2} vs 0 contact"


def release():
    """A pulse's end to the end of the coil's current, in ms; highest voltage at the drain; the clamp's energy in mJ."""
    lines = """tran 2u 13m 0 2u
meas tran t when i(lc1)=0.2m fall=1
meas tran peak max v({J6.2})
let p = v({J6.2})*i(lc1)
meas tran energy integ p from=10.001m to=12m"""
    found = run(lines, valves=PULSE)
    return 1e3 * found["t"] - 10.001, found["peak"], 1e3 * found["energy"]


def stopped():
    """From the stop to a tenth of the current, with the transistor still on, in ms."""
    lines = "tran 2u 20m 0 2u\nmeas tran i0 find i(lc1) at=9.9m\nlet z = i(lc1) - 0.1*i0\nmeas tran t when z=0 fall=1"
    return 1e3 * run(lines, valves=ON, stop_power=OPENS)["t"] - 10.0


def run_line_falls():
    """From the opened contact to a sure low, 0.8 V, in us."""
    sense = "Vs vs 0 pulse(1 0 1m 10n 10n 1 2)\nS2 {J2.3} {J2.4} vs 0 contact"
    lines = "tran 0.1u 1.2m 0 0.1u\nmeas tran t when v({RUN_LINE})=0.8 fall=1"
    return 1e6 * run(lines, stop_sense=sense)["t"] - 1000.0


def volts(net, **replaced):
    return run(f"op\nlet y = v({{{net}}})\nprint y", **replaced)["y"]


def figures():
    """Every figure by the words of the document."""
    end, peak, energy = release()
    yield "gas at 270 K, % of the reference", share("GAS", gas=gas(270.0))
    yield "gas at 330 K, % of the reference", share("GAS", gas=gas(330.0))
    yield "gain of the amplifier", amplifier_gain()
    yield "offset at its negative input, % of the reference", 100.0 * volts("U1.3") / VREF
    yield "slope at 298 K, mV/K", gas_slope()
    yield "current in the Pt1000 at 298.15 K, mA", volts("J3.1") / 1097.35 * 1e3
    yield "bandwidth of the gas channel, kHz", bandwidth("GAS", gas="Rpt {J3.1} g 1097.35\nVac g {J3.2} dc 0 ac 1")
    yield "bandwidth of the pressure channel, kHz", bandwidth("PRESSURE", pressure="Vp {J4.2} {GNDA} dc 1.65 ac 1")
    top = "Rl1 {J5.1} g 2.5k\nVac g {J5.2} dc 0 ac 1\nRl2 {J5.2} {J5.3} 2.5k"
    yield "bandwidth of the length channel, wiper in the middle, kHz", bandwidth("LENGTH", length=top)
    ends = "Rl1 {J5.1} {J5.2} %s\nRl2 {J5.2} {J5.3} %s"
    yield "length at its lower end, % of the reference", share("LENGTH", length=ends % ("5k", "1m"))
    yield "length at its upper end, % of the reference", share("LENGTH", length=ends % ("1m", "5k"))
    yield "cut-off above, kPa", pressure(cut_off(False, (0.5, 0.95)))
    yield "back below, kPa", pressure(cut_off(True, (0.95, 0.5)))
    yield "cut-off below, % of the reference", cut_off(False, (0.1, 0.01))
    yield "valves' supply, second sensor unplugged, V", volts("VALVE_24V", pressure_2="")
    plug = "Ra {J8.1} {J8.2} 10k\nRb {J8.2} {J8.3} 10k"
    yield "valves' supply, plug in its place, V", volts("VALVE_24V", pressure_2=plug)
    yield "valves' supply, stop pressed, V", volts("VALVE_24V", stop_power="")
    yield "run line at 24 V, V", volts("RUN_LINE")
    yield "run line low after the stop, us", run_line_falls()
    yield "end of the coil's current after a pulse, ms", end
    yield "highest voltage at the drain, V", peak
    yield "energy in the clamp of a pulse, mJ", energy
    yield "current down to 10 % after the stop with the transistor on, ms", stopped()
    leaky = "Ig1 0 {INLET} 120u\nVg2 {OUTLET} 0 0"
    yield "gate at a leaky pin of a Pico 2 (120 uA), V", volts("Q1.1", valves=leaky)
    leaky = OUTSIDE["pico"] + "\nIr 0 {RUN_LINE} 120u"
    yield "run line at a leaky pin of a Pico 2 (120 uA), stopped, V", volts("RUN_LINE", pico=leaky, stop_sense="")
    yield "gate at a floating pin, V", volts("Q1.1", valves="Vg2 {OUTLET} 0 0")
    yield from broken()


def broken():
    """Readings of broken sensors, in per cent of the reference."""
    short, supply = "Rx {%s} {GNDA} 1", "Rx {%s} {+3.3VA} 1"
    yield "pressure, signal open, % of the reference", share("PRESSURE", pressure="")
    yield "pressure, signal to ground, % of the reference", share("PRESSURE", pressure=short % "J4.2")
    yield "pressure, signal to supply, % of the reference", share("PRESSURE", pressure=supply % "J4.2")
    yield "gas, a wire open, % of the reference", share("GAS", gas="")
    yield "gas, short circuit, % of the reference", share("GAS", gas=short % "J3.1")
    yield "gas, signal to supply, % of the reference", share("GAS", gas=supply % "J3.1")
    track, low, high = "Rl {J5.1} {J5.3} 5k\n", "Rl2 {J5.2} {J5.3} 2.5k", "Rl1 {J5.1} {J5.2} 2.5k"
    yield "length, wiper open, % of the reference", share("LENGTH", length=track)
    yield "length, upper end open, % of the reference", share("LENGTH", length=low)
    yield "length, lower end open, % of the reference", share("LENGTH", length=high)
    yield "length, wiper to ground, % of the reference", share("LENGTH", length=track + short % "J5.2")
    yield "length, wiper to supply, % of the reference", share("LENGTH", length=track + supply % "J5.2")


def documented():
    """Figure and documented value: a number, or a bound such as `below 2`."""
    section = DOCUMENT.read_text().split("## Figures of the circuit")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([^|]+?) \| ([^|]+?) \|", section, re.MULTILINE)
    return {name: stated for name, stated in rows if name != "figure"}


def met(found, stated):
    bound = re.match(r"(above|below) ([\d.]+)", stated)
    if bound:
        return found > float(bound[2]) if bound[1] == "above" else found < float(bound[2])
    return abs(found - float(stated)) <= ALLOWED * abs(float(stated))


def main():
    stated, wrong, named = documented(), 0, set()
    for name, found in figures():
        named.add(name)
        fits = name in stated and met(found, stated[name])
        wrong += not fits
        print(f"{'ok   ' if fits else 'WRONG'} {name}: {found:.4g}, documented {stated.get(name, 'not')}")
    for name in stated.keys() - named:
        wrong += 1
        print(f"WRONG {name}: documented, not simulated")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
