"""The paper's Fig. 5: what the sensor in the gas shows over 20 strokes, simulated and by the model."""

import matplotlib.pyplot as plt
import thermyo

run = thermyo.run("scenarios/reproduce.toml")
for column, label in (("sensor_gas_k", "sensor"), ("model_sensor_k", "model")):
    plt.plot(run["time_s"], run[column], label=label)
plt.xlabel("time / s")
plt.ylabel("temperature / K")
plt.legend()
plt.savefig("figure_5.png")
