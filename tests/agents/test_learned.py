"""Learned policies: what ships flies, files run no code, and what SB3 saved predicts as in SB3."""

from __future__ import annotations

import json
import pickle
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium import Env
from gymnasium.spaces import Box
from sb3_contrib import ARS, TQC, TRPO, CrossQ, RecurrentPPO
from scipy.stats import wilcoxon
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from agents.card import digest, read_card
from agents.learned import LearnedPolicy
from agents.loading import load_network
from agents.registry import load, shipped
from agents.residual import Residual
from eval.rollout import PUBLIC_SEEDS, rollout
from visenvs.core.lanes import Lanes
from visenvs.core.registry import environment_files, load_task

TASK = load_task("visenvs/Rendezvous-v0")
CONFIG = TASK.scenarios["random"]
OTHER = load_task("visenvs/BearingsOnly-v0")
SHIPPED = [(env, name) for env in environment_files() for name in shipped(env)]
SMALL = {"n_steps": 8, "batch_size": 8}


class Still(Env):
    """Spaces of the rendezvous, for SB3 to build a model on; nobody flies it."""

    observation_space, action_space = TASK.observation.space, TASK.action.space


class OwnExtractor(FlattenExtractor):
    """A features extractor with weights."""

    def __init__(self, observation_space):
        super().__init__(observation_space)
        self.mix = nn.Linear(self.features_dim, self.features_dim)

    def forward(self, observations):
        return self.mix(super().forward(observations))


class Backwards(FlattenExtractor):
    """A features extractor without weights."""

    def forward(self, observations):
        return super().forward(observations).flip(1)


class Halved(ActorCriticPolicy):
    """A policy that has PPO's weights and acts otherwise."""

    def _predict(self, observation, deterministic=False):
        return 0.5 * super()._predict(observation, deterministic)


def ppo(use_sde=False, **policy):
    settings = {"policy_kwargs": policy, "device": "cpu", "seed": 3, **SMALL}
    return PPO("MlpPolicy", Still(), use_sde=use_sde, **settings)


def recurrent(use_sde=False, **policy):
    settings = {"policy_kwargs": policy, "device": "cpu", "seed": 3, **SMALL}
    return RecurrentPPO("MlpLstmPolicy", Still(), use_sde=use_sde, **settings)


def far(model):
    """With means so far out that a tanh and a clip differ."""
    with torch.no_grad():
        model.policy.action_net.weight *= 200.0
    return model


def off_policy(algorithm, use_sde=None, **policy):
    settings = {"policy_kwargs": policy, "device": "cpu", "seed": 3, "buffer_size": 10}
    settings |= {} if use_sde is None else {"use_sde": use_sde}
    return algorithm("MlpPolicy", Still(), **settings)


def saved(model, folder):
    """Path of what `model.save` writes."""
    model.save(folder / "model.zip")
    return folder / "model.zip"


def rewritten(path, target, **parts):
    """A copy of a zip with some parts replaced, or left out where None."""
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(target, "w") as copy:
        for name in source.namelist():
            if name not in parts:
                copy.writestr(name, source.read(name))
        for name, content in parts.items():
            if content is not None:
                copy.writestr(name, content)
    return target


def some_rows(count=20, seed=0):
    box = TASK.observation.space
    rng = np.random.default_rng(seed)
    return rng.uniform(box.low, box.high, (count, *box.shape)).astype(np.float32)


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """Networks of this size are faster without threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def file(tmp_path):
    return saved(ppo(net_arch=[4]), tmp_path)


# what ships


def test_every_environment_has_a_learned_policy():
    assert {env for env, _ in SHIPPED} >= set(environment_files())


@pytest.mark.parametrize("env, name", SHIPPED)
def test_what_ships_loads_without_trust_and_flies(env, name):
    task = load_task(env)
    config = next(iter(task.scenarios.values()))
    entry = load(name, task, config)
    card = read_card(shipped(env)[name])
    assert entry.kind == ("residual" if card["residual"] else "learned")
    flown = rollout(entry.policy, task, entry.config, range(90_000, 90_002))
    assert np.isfinite(flown.returns).all()


@pytest.mark.parametrize("env, name", SHIPPED)
def test_its_card_tells_what_it_is(env, name):
    path = shipped(env)[name]
    card = read_card(path)
    task = load_task(env)
    scenario = task.scenarios[card["scenario"]]
    assert card["sha256"] == digest(path)
    assert card["env"] == env
    assert card["information"] in {*(task.views or {"belief"}), *task.pictures}
    # no picture tells what a filter makes of it
    pictures = card["information"] in task.pictures
    assert card["estimator"] == ("truth" if pictures else scenario.estimator)
    count = card["reached"]["episodes"] // task.team(scenario)
    # missions of herding are long, and pictures take their time
    assert count == (100 if env == "visenvs/Herding-v0" else 200 if pictures else 1000)
    first, last = card["seeds"]["training"]
    assert 0 <= first < last < 90_000
    assert card["seeds"]["validation"] == [90_000, 89_999 + count]
    assert card["command"].startswith(("python -m train.sb3 ", "python -m train.search "))
    assert {"torch", "stable-baselines3", "numpy"} <= set(card["versions"])


def test_the_shipped_residual_beats_its_law():
    policies = [load(name, TASK, CONFIG).policy for name in ("ppo-lq", "lq")]
    ours, law = (-rollout(p, TASK, CONFIG, PUBLIC_SEEDS[:100]).returns for p in policies)
    for figure in (np.mean, np.median, lambda cost: np.percentile(cost, 95)):
        assert figure(ours) < figure(law)
    # seed by seed; by ranks, since single disasters of the law would drown a mean difference
    assert wilcoxon(law - ours, alternative="greater").pvalue < 1e-3


def test_a_file_that_was_changed_is_refused(tmp_path):
    folder = shipped(TASK.id)["ppo-lq"].parent
    shutil.copytree(folder, tmp_path / "copy")
    model = tmp_path / "copy" / "model.zip"
    assert load(str(model.parent), TASK, CONFIG).kind == "residual"
    with zipfile.ZipFile(model, "a") as archive:
        archive.writestr("more", "")
    with pytest.raises(ValueError, match=r"does not belong to model.zip: the sha256 differs; take"):
        load(str(model), TASK, CONFIG)
    (model.parent / "card.json").unlink()
    assert load(str(model), TASK, CONFIG).kind == "learned"


# the same as SB3


MODELS = {
    "ppo": lambda: ppo(net_arch=[5, 7], log_std_init=-1.0),
    "ppo without a hidden layer": lambda: ppo(net_arch=[]),
    "ppo of two widths": lambda: ppo(net_arch={"pi": [3], "vf": [6, 2]}, activation_fn=nn.ReLU),
    "ppo with eleven layers": lambda: ppo(net_arch=[3, 4, 5, 6, 7, 8, 9, 8, 7, 6, 5]),
    "ppo with state-dependent exploration": lambda: ppo(use_sde=True, net_arch=[5, 7]),
    "ppo whose actions are squashed": lambda: far(
        ppo(use_sde=True, squash_output=True, activation_fn=nn.ReLU)
    ),
    "sac": lambda: off_policy(SAC, net_arch=[5, 4]),
    "sac of two widths": lambda: off_policy(
        SAC, net_arch={"pi": [3], "qf": [4, 4]}, activation_fn=nn.SiLU
    ),
    "td3": lambda: off_policy(TD3, net_arch=[5, 4], activation_fn=nn.ELU),
    "a2c": lambda: A2C("MlpPolicy", Still(), device="cpu", seed=3),
    "trpo": lambda: TRPO("MlpPolicy", Still(), device="cpu", seed=3, **SMALL),
    "ddpg": lambda: off_policy(DDPG, net_arch=[5, 4]),
    "td3 with one critic": lambda: off_policy(TD3, net_arch=[5, 4], n_critics=1),
    "sac with three critics": lambda: off_policy(SAC, net_arch=[5, 4], n_critics=3),
    "sac with state-dependent exploration": lambda: off_policy(
        SAC, use_sde=True, net_arch=[5, 4], clip_mean=0.01
    ),
    "tqc": lambda: off_policy(TQC, net_arch=[5, 4]),
    "recurrent ppo of two layers": lambda: recurrent(
        net_arch=[5], lstm_hidden_size=6, n_lstm_layers=2
    ),
    "recurrent ppo with a shared memory": lambda: recurrent(
        net_arch=[5], lstm_hidden_size=6, shared_lstm=True, enable_critic_lstm=False
    ),
    "recurrent ppo": lambda: recurrent(net_arch=[5], lstm_hidden_size=6),
    "recurrent ppo, one memory": lambda: recurrent(
        net_arch=[], lstm_hidden_size=6, enable_critic_lstm=False
    ),
    "recurrent ppo whose actions are squashed": lambda: far(
        recurrent(use_sde=True, squash_output=True, net_arch=[5], lstm_hidden_size=6)
    ),
}


@pytest.mark.parametrize("trust", [False, True])
@pytest.mark.parametrize("kind", MODELS)
def test_a_saved_model_predicts_what_sb3s_own_does(kind, trust, tmp_path):
    model = MODELS[kind]()
    policy = LearnedPolicy(load_network(saved(model, tmp_path), TASK, trust), TASK)
    rows = some_rows()
    expected, _ = model.predict(rows, deterministic=True)
    found, _ = policy.predict(rows)
    assert np.array_equal(found, expected)
    assert (found.dtype, found.shape) == (np.float32, (20, TASK.action.size))
    assert np.abs(np.diff(expected, axis=0)).max() > 1e-3  # it looks at the rows


def test_memory_is_carried_on_and_cleared_as_in_sb3(tmp_path):
    model = recurrent(net_arch=[5], lstm_hidden_size=6)
    policy = LearnedPolicy(load_network(saved(model, tmp_path), TASK), TASK)
    mine = theirs = None
    starts = np.array([[1, 1, 1], [0, 0, 0], [0, 1, 0], [0, 0, 1]], bool)
    for step, start in enumerate(starts):
        rows = some_rows(3, seed=step)
        found, mine = policy.predict(rows, mine, start)
        expected, theirs = model.predict(rows, theirs, start, deterministic=True)
        assert np.array_equal(found, expected)
        afresh, _ = policy.predict(rows)
        assert (found == afresh).all(axis=1).tolist() == start.tolist()
    for ours, other in zip(mine, theirs, strict=True):
        assert np.array_equal(ours, other)


def test_a_sample_is_drawn_where_asked_for(file):
    policy, rows = LearnedPolicy(load_network(file, TASK), TASK), some_rows()
    mean, _ = policy.predict(rows)
    drawn, _ = policy.predict(rows, deterministic=False)
    assert (mean != drawn).any()
    assert np.abs(drawn).max() <= 1.0


def test_a_residual_flies_the_law_and_its_share_of_the_network(file):
    card = {
        "information": "belief",
        "algo": "ppo",
        "steps": 0,
        "residual": {"law": "pn", "scale": 0.25},
        "sha256": digest(file),
    }
    file.with_name("card.json").write_text(json.dumps(card))
    entry = load(str(file.parent), TASK, CONFIG)
    assert (entry.kind, entry.summary) == ("residual", "ppo, residual on pn, 0 steps")
    lanes = Lanes(TASK, CONFIG, 8)
    lanes.reset(range(8))
    found, _ = entry.policy.predict(lanes.rows)
    law, _ = load("pn", TASK, CONFIG).policy.predict(lanes.rows)
    net, _ = load_network(file, TASK).predict(lanes.rows, deterministic=True)
    assert found == pytest.approx(np.clip(law + 0.25 * net, -1.0, 1.0), abs=1e-6)
    assert np.abs(found - law).max() > 1e-3


def test_a_correction_is_never_more_than_its_share(tmp_path):
    """Of a network whose means lie far beyond its box, SB3 gives the edge; so in training."""
    model = ppo(net_arch=[4])
    with torch.no_grad():
        model.policy.action_net.bias += 9.0
    network = load_network(saved(model, tmp_path), TASK)
    law = load("pn", TASK, CONFIG).policy
    lanes = Lanes(TASK, CONFIG, 8)
    lanes.reset(range(8))
    found, _ = LearnedPolicy(network, TASK, Residual(law, 0.25)).predict(lanes.rows)
    expected = np.clip(law.predict(lanes.rows)[0] + 0.25, -1.0, 1.0)
    assert found == pytest.approx(expected, abs=1e-6)


# trust


class Trap:
    """Writes a file when it is unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return Path.touch, (Path(self.path),)


class Bomb:
    """Breaks when it is unpickled."""

    def __reduce__(self):
        return divmod, (1, 0)


def encoded(trap):
    """As SB3 keeps what is not JSON."""
    import base64

    import cloudpickle

    return {
        ":type:": "<class 'object'>",
        ":serialized:": base64.b64encode(cloudpickle.dumps(trap)).decode(),
    }


def test_loading_runs_no_code_unless_trusted(file, tmp_path):
    trap = tmp_path / "sprung"
    with zipfile.ZipFile(file) as archive:
        data = json.loads(archive.read("data"))
    data["lr_schedule"] = encoded(Trap(trap))
    armed = rewritten(file, tmp_path / "armed.zip", data=json.dumps(data))
    quiet = load(str(armed), TASK, CONFIG).policy
    assert not trap.exists()
    trusted = load(str(armed), TASK, CONFIG, trust=True).policy
    assert trap.exists()
    assert np.array_equal(quiet.predict(some_rows())[0], trusted.predict(some_rows())[0])


@pytest.mark.parametrize("trust", [False, True])
def test_pickled_weights_are_never_run(file, tmp_path, trust):
    trap = tmp_path / "sprung"
    weights = tmp_path / "policy.pth"
    torch.save({"mlp_extractor.policy_net.0.weight": Trap(trap)}, weights)
    armed = rewritten(file, tmp_path / "armed.zip", **{"policy.pth": weights.read_bytes()})
    with pytest.raises(ValueError, match="not a stable-baselines3 model that can be read safely"):
        load(str(armed), TASK, CONFIG, trust=trust)
    plain = pickle.dumps(Trap(trap))
    armed = rewritten(file, tmp_path / "armed.zip", **{"policy.pth": plain})
    with pytest.raises(ValueError, match="not a stable-baselines3 model that can be read safely"):
        load(str(armed), TASK, CONFIG, trust=trust)
    assert not trap.exists()


def test_a_card_cannot_name_code_to_run(file, tmp_path, monkeypatch):
    (tmp_path / "own_law.py").write_text("from pathlib import Path\nPath('sprung').touch()\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    card = dict(information="belief", algo="ppo", steps=0, sha256=digest(file))
    for law in ("own_law:make", str(file), "zero"):
        card["residual"] = {"law": law, "scale": 0.3}
        file.with_name("card.json").write_text(json.dumps(card))
        with pytest.raises(ValueError, match=r"unknown law .* Known: .*lq"):
            load(str(file), TASK, CONFIG)
    assert not Path("sprung").exists()


# bad files


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 broken off", b"plain text"])
def test_what_is_no_zip_is_refused(content, tmp_path):
    path = tmp_path / "model.zip"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"model.zip is not a stable-baselines3 model .*save"):
        load(str(path), TASK, CONFIG)


def test_a_zip_that_was_cut_off_is_refused(file):
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(ValueError, match="is not a stable-baselines3 model"):
        load(str(file), TASK, CONFIG)


@pytest.mark.parametrize(
    "parts",
    [
        {"data": None},
        {"policy.pth": None},
        {"data": "not JSON"},
        {"data": "[1, 2]"},
        {"policy.pth": b"no tensors"},
    ],
    ids=str,
)
def test_a_zip_of_something_else_is_refused(file, tmp_path, parts):
    other = rewritten(file, tmp_path / "other.zip", **parts)
    with pytest.raises(ValueError, match=r"other.zip is not a stable-baselines3 model"):
        load(str(other), TASK, CONFIG)


def test_weights_of_something_else_are_refused(file, tmp_path):
    torch.save({"linear.weight": torch.zeros(2, 2)}, tmp_path / "w")
    other = rewritten(file, tmp_path / "other.zip", **{"policy.pth": (tmp_path / "w").read_bytes()})
    with pytest.raises(ValueError, match="not of a PPO, RecurrentPPO, SAC or TD3 policy"):
        load(str(other), TASK, CONFIG)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"no model .*nowhere.zip; expected what .*train.sb3"):
        load(str(tmp_path / "nowhere.zip"), TASK, CONFIG)
    with pytest.raises(ValueError, match=r"no model .*model.zip"):
        load(str(tmp_path), TASK, CONFIG)
    with pytest.raises(ValueError, match=r"no file .*nowhere.zip"):
        load_network(tmp_path / "nowhere.zip", TASK)


@pytest.mark.parametrize("trust", [False, True])
@pytest.mark.parametrize("kind", ["ppo", "sac", "td3", "recurrent ppo"])
def test_a_model_for_other_rows_is_refused(kind, trust, tmp_path):
    path = saved(MODELS[kind](), tmp_path)
    words = (
        f"trained on observations of {TASK.observation.size} numbers, {OTHER.id} gives "
        f"{OTHER.observation.size} .*range_hat.* --env {OTHER.id}"
    )
    with pytest.raises(ValueError, match=words):
        load_network(path, OTHER, trust)


def test_a_model_of_other_actions_is_refused_though_trusted(tmp_path):
    env = Still()
    env.action_space = Box(-1.0, 1.0, (TASK.action.size + 1,), np.float32)
    path = saved(PPO("MlpPolicy", env, device="cpu", **SMALL), tmp_path)
    with pytest.raises(ValueError, match=r"was trained on actions Box.*Rendezvous-v0 takes "):
        load_network(path, TASK, trust=True)


def test_weights_that_do_not_fit_together_are_refused(file, tmp_path):
    with zipfile.ZipFile(file) as archive, archive.open("policy.pth") as part:
        weights = torch.load(part, weights_only=True)
    weights["action_net.weight"] = torch.zeros(5, 4)
    torch.save(weights, tmp_path / "w")
    other = rewritten(file, tmp_path / "other.zip", **{"policy.pth": (tmp_path / "w").read_bytes()})
    words = "the weights do not fit ppo on visenvs/Rendezvous-v0: size mismatch .*--trust loads it"
    with pytest.raises(ValueError, match=words) as refused:
        load(str(other), TASK, CONFIG)
    assert "\n" not in str(refused.value)


def flies_as(model, path, trust):
    """Whether the file's policy does exactly what SB3's model does."""
    policy = load(str(path), TASK, CONFIG, trust=trust).policy
    expected, _ = model.predict(some_rows(), deterministic=True)
    return np.array_equal(policy.predict(some_rows())[0], expected)


@pytest.mark.parametrize("trust", [False, True])
@pytest.mark.parametrize("algorithm", [CrossQ, ARS])
def test_other_algorithms_are_refused_with_what_to_do(algorithm, trust, tmp_path):
    settings = {"buffer_size": 10} if algorithm is CrossQ else {}
    path = saved(algorithm("MlpPolicy", Still(), device="cpu", **settings), tmp_path)
    with pytest.raises(ValueError, match=r"not of a PPO.* with or without --trust; fly it as `mod"):
        load(str(path), TASK, CONFIG, trust=trust)


def test_an_unknown_activation_needs_trust(tmp_path):
    model = ppo(net_arch=[4], activation_fn=nn.Softplus)
    path = saved(model, tmp_path)
    with pytest.raises(ValueError, match=r"activation 'Softplus' is not .* needs --trust"):
        load(str(path), TASK, CONFIG)
    assert flies_as(model, path, trust=True)


@pytest.mark.parametrize(
    "extractor, words", [(OwnExtractor, "features_"), (Backwards, "Backwards")]
)
def test_an_extractor_of_its_own_needs_trust(extractor, words, tmp_path):
    model = ppo(net_arch=[4], features_extractor_class=extractor)
    path = saved(model, tmp_path)
    with pytest.raises(ValueError, match=rf"extractor of its own \({words}.*needs --trust"):
        load(str(path), TASK, CONFIG)
    assert flies_as(model, path, trust=True)


def test_a_policy_class_of_its_own_needs_trust(tmp_path):
    model = PPO(Halved, Still(), device="cpu", **SMALL)
    path = saved(model, tmp_path)
    with pytest.raises(ValueError, match=r"policy class of its own \(in .*needs --trust"):
        load(str(path), TASK, CONFIG)
    assert flies_as(model, path, trust=True)


@pytest.mark.parametrize(
    "text, words",
    [
        ("{", "card.json is not JSON"),
        ("[]", "does not belong to model.zip"),
        ("{}", "does not belong to model.zip"),
    ],
)
def test_a_broken_card_is_refused(file, text, words):
    file.with_name("card.json").write_text(text)
    with pytest.raises(ValueError, match=words):
        load(str(file), TASK, CONFIG)


@pytest.mark.parametrize(
    "residual",
    ["lq", {"law": "lq"}, {"scale": 0.3}, 1, {}, {"law": "lq", "scale": 0.3, "reads": "t_go"}],
)
def test_a_card_with_half_a_residual_is_refused(file, residual):
    card = dict(information="belief", algo="ppo", steps=0, residual=residual, sha256=digest(file))
    file.with_name("card.json").write_text(json.dumps(card))
    with pytest.raises(ValueError, match=r'residual must be null or \{"law": NAME, "scale": NUM'):
        load(str(file), TASK, CONFIG)


def test_a_trusted_file_that_fails_is_told(tmp_path):
    """What it needs is not here, or its own code breaks."""
    path = saved(ppo(net_arch=[4], features_extractor_class=OwnExtractor), tmp_path)
    with zipfile.ZipFile(path) as archive:
        data = json.loads(archive.read("data"))
    data["policy_kwargs"] = encoded(Bomb())
    armed = rewritten(path, tmp_path / "armed.zip", data=json.dumps(data))
    with pytest.raises(ValueError, match=r"armed.zip cannot be loaded, even with"):
        load_network(armed, TASK, trust=True)


def test_a_card_that_says_too_little_is_refused(file):
    file.with_name("card.json").write_text(json.dumps({"sha256": digest(file), "algo": "ppo"}))
    with pytest.raises(
        ValueError, match="does not say information, residual, steps; expected what"
    ):
        load(str(file), TASK, CONFIG)
