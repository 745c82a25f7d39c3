"""Training where actions are choices, and where several lanes fly together."""

import numpy as np
import pytest
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported

from agents.registry import load
from eval.rollout import rollout
from tests.toys import toys
from train import build, sb3
from train.imitation import imitate
from train.presets import DEFAULTS, Preset
from train.sb3 import Options, train
from train.vec_env import LaneVecEnv
from visenvs.core.config import override
from visenvs.core.registry import load_task

pytestmark = pytest.mark.filterwarnings("ignore::tqdm.TqdmExperimentalWarning")

CONVOY, STAIRS = "visenvs/Convoy-v0", "visenvs/Stairs-v0"


@pytest.fixture(autouse=True)
def only_toys():
    with toys():
        yield


def test_the_adapter_tells_which_choices_may_be_taken():
    task = load_task(STAIRS)
    lanes = LaneVecEnv(task, task.scenarios["plain"], range(4))
    lanes.reset()
    assert is_masking_supported(lanes)
    assert np.array_equal(get_action_masks(lanes), lanes.lanes.records["allowed"] > 0.5)
    convoy = LaneVecEnv(load_task(CONVOY), load_task(CONVOY).scenarios["alone"], range(4))
    assert not is_masking_supported(convoy)
    with pytest.raises(AttributeError, match="no method 'action_masks'"):
        convoy.env_method("action_masks")


def test_a_policy_that_chooses_is_trained_saved_and_flown(tmp_path, monkeypatch):
    quick = DEFAULTS["maskable_ppo"].model | {"n_steps": 100, "batch_size": 200}
    preset = Preset(16, quick | {"learning_rate": 2e-3}, {"net_arch": [32]})
    monkeypatch.setattr(sb3, "preset_for", lambda env, algo, pictures: preset)
    monkeypatch.setattr(build, "VALIDATION_SEEDS", range(90_000, 90_050))
    train(Options(out=tmp_path / "run", env=STAIRS, algo="maskable_ppo", steps=20_000))
    task = load_task(STAIRS)
    config = task.scenarios["plain"]
    learned = load(str(tmp_path / "run"), task, config)
    blind = load("random", task, config)
    costs = [
        rollout(entry.policy, task, config, range(100_000, 100_100)).records["total_cost"].mean()
        for entry in (learned, blind)
    ]
    assert costs[0] < 0.5 * costs[1]


class Towards:
    """Goes straight to the landing."""

    def predict(self, rows, state=None, episode_start=None, deterministic=True):
        return np.where(rows[:, 0] > rows[:, 1], 1, np.where(rows[:, 0] < rows[:, 1], 2, 0)), None


def test_imitation_ends_in_the_laws_own_choices_where_the_network_flies():
    task = load_task(STAIRS)
    lanes = LaneVecEnv(task, task.scenarios["plain"], range(16))
    wide = {"net_arch": [64, 64]}
    model = MaskablePPO("MlpPolicy", lanes, policy_kwargs=wide, seed=0, device="cpu")
    assert imitate(model.policy, lanes, Towards(), 40_000) > 0.98
    seen = lanes.reset()
    mask = lanes.lanes.allowed
    own = model.policy.predict(seen, action_masks=mask, deterministic=True)[0]
    assert np.array_equal(own, Towards().predict(seen)[0])


def test_what_cannot_choose_is_refused(tmp_path):
    with pytest.raises(ValueError, match="ppo cannot learn them; write --algo maskable_ppo"):
        train(Options(out=tmp_path / "a", env=STAIRS))
    with pytest.raises(ValueError, match="maskable_ppo cannot learn them; write --algo ppo"):
        train(Options(out=tmp_path / "b", env=CONVOY, algo="maskable_ppo"))
    assert not list(tmp_path.iterdir())


def test_agents_of_a_team_are_rows_that_begin_anew_together():
    task = load_task(CONVOY)
    config = override(task.scenarios["alone"], {"carts": 3, "lost": 0.5})
    lanes = LaneVecEnv(task, config, range(2))
    assert lanes.num_envs == 6 and lanes.reset().shape[0] == 6
    rng = np.random.default_rng(0)
    for _ in range(100):
        _, _, dones, infos = lanes.step(rng.uniform(-1, 1, (6, 1)).astype(np.float32))
        teams = dones.reshape(2, 3)
        assert (teams.all(axis=1) == teams.any(axis=1)).all()
        assert ["terminal_observation" in info for info in infos] == dones.tolist()
    assert lanes.lanes.records["episode"].max() > 0
