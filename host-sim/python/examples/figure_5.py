"""The paper's Fig. 5: reading of the sensor in the gas over 20 strokes, simulated and by the model."""

import matplotlib.pyplot as plt
import thermyo

run = thermyo.run("scenarios/reproduce.toml")
for column, label in (("sensor_gas_k", "sensor"), ("model_sensor_k", "model")):
    plt.plot(run["time_s"], run[column], label=label)
plt.xlabel("time / s")
plt.ylabel("temperature / K")
plt.legend()
plt.savefig("figure_5.png")
