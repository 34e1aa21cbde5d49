"""Results as Python objects; thermyo.pyi documents them."""

SUMMARY = "summary"
# Panels of a plot: columns over each other.
PANELS = (
    ("pressure_pa", "measured_pressure_pa"),
    ("gas_temperature_k", "sensor_gas_k", "estimate_k"),
    ("length_m", "measured_length_m"),
    ("duty_in", "duty_out"),
    # Of a joint.
    ("angle_rad", "angle_reference_rad"),
    ("stiffness_n_m_rad", "stiffness_reference_n_m_rad"),
    ("a_pressure_pa", "b_pressure_pa"),
    ("a_gas_temperature_k", "a_estimate_k", "b_gas_temperature_k", "b_estimate_k"),
)


class Run(dict):
    # Symbol and factor of the shown unit of each column.
    _units = {}

    @property
    def summary(self):
        return self[SUMMARY]

    @property
    def columns(self):
        return [name for name in self if name != SUMMARY]

    def to_pandas(self):
        import pandas

        return pandas.DataFrame({name: self[name] for name in self.columns}).set_index("time_s")

    def plot(self, *columns):
        import matplotlib.pyplot as plt
        import numpy

        unknown = [name for name in columns if name not in self.columns]
        if unknown:
            raise KeyError(f"{unknown[0]}: must be one of {', '.join(self.columns)}")
        panels = [(name,) for name in columns] or PANELS
        # A vessel has no length, and a board no true values.
        has = lambda name: name in self and not numpy.isnan(self[name]).all()
        panels = [tuple(filter(has, names)) for names in panels]
        panels = [names for names in panels if names]
        figure, axes = plt.subplots(len(panels), 1, sharex=True, squeeze=False, layout="constrained")
        for names, axis in zip(panels, axes[:, 0]):
            symbol, factor = self._units.get(names[0], ("", 1.0))
            for name in names:
                axis.plot(self["time_s"], self[name] * factor, label=name.rsplit("_", 1)[0] if symbol else name)
            axis.set_ylabel(f"{names[0].rsplit('_', 1)[0]} / {symbol}" if symbol else names[0])
            if len(names) > 1:
                axis.legend()
        axes[-1, 0].set_xlabel("time / s")
        return figure

    def __repr__(self):
        rows = len(self["time_s"])
        return f"<thermyo.Run of {rows} rows and {len(self.columns)} columns>"


def recorded(stream):
    import numpy

    rows = list(stream)
    if not rows:
        raise ValueError("nothing was recorded: duration_s is too short")
    words = ("mode", "faults")
    table = {"time_s": None}
    for name in rows[0]:
        values = [row[name] for row in rows]
        table[name] = values if name in words else numpy.array(values, dtype=numpy.float64)
    vented = [row["faults"] for row in rows if row["faults"]]
    table[SUMMARY] = {"duration_s": rows[-1]["time_s"], "rows": len(rows), "faults": vented[0] if vented else []}
    return Run(table)


def record(header, row):
    import csv

    cells = zip(header.split(","), next(csv.reader([row])))
    return {name: value(cell) for name, cell in cells if name != "checksum"}


def value(cell):
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            pass
    return cell or None
