"""An environment for gymnasium: the muscle follows a pressure, and the agent drives its valves.

`python gym_env.py` drives it by a proportional controller, and prints how well that does.
"""

import gymnasium
import numpy
import thermyo

SCENARIO = {"plant": {"model": "lumped"}, "drive": {"kind": "closed"}}
LOWEST_PA, HIGHEST_PA = 1.3e5, 3.0e5


class MuscleEnv(gymnasium.Env):
    """Observation: measured pressure, its set point, length and the sensor in the gas, each about 1. Action: -1, only the
    outlet open, to 1, only the inlet. Reward: minus the error, at most 0."""

    steps_per_action = 10
    actions_per_episode = 500

    def __init__(self, scenario=SCENARIO):
        self.scenario = scenario
        self.observation_space = gymnasium.spaces.Box(0.0, 10.0, (4,), numpy.float64)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), numpy.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.muscle = thermyo.Muscle(self.scenario, seed=int(self.np_random.integers(2**31)))
        self.wanted_pa = self.np_random.uniform(LOWEST_PA, HIGHEST_PA)
        self.actions = 0
        return self.observed(), {}

    def step(self, action):
        drive = float(numpy.clip(action, -1.0, 1.0)[0])
        for _ in range(self.steps_per_action):
            readings = self.muscle.step(max(drive, 0.0), max(-drive, 0.0))
        self.actions += 1
        reward = -abs(readings.pressure_pa - self.wanted_pa) / 1e5
        truncated = self.actions >= self.actions_per_episode
        return self.observed(), reward, False, truncated, {}

    def observed(self):
        readings = self.muscle.readings
        return numpy.array(
            [
                readings.measured_pressure_pa / 1e5,
                self.wanted_pa / 1e5,
                readings.measured_length_m / self.muscle.rest_length_m,
                readings.sensor_gas_k / 300.0,
            ]
        )


if __name__ == "__main__":
    env = MuscleEnv()
    observation, _ = env.reset(seed=1)
    total, truncated = 0.0, False
    while not truncated:
        pressure, wanted, *_ = observation
        observation, reward, _, truncated, _ = env.step([2.0 * (wanted - pressure)])
        total += reward
    print(f"mean error {-total / env.actions_per_episode * 100:.2f} kPa")
