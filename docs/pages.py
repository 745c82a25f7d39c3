"""Pages made from the code itself: one for each environment, estimator module and guidance law.

A Sphinx extension. Before the build it writes Markdown into docs/generated/, from the task cards,
the layouts, the configurations with their comments, the law cards and the docstrings, so that the
documents cannot say anything else than the code.
"""

from __future__ import annotations

import ast
import dataclasses
import io
import json
import tokenize
from collections.abc import Iterator
from importlib import import_module
from inspect import getdoc, getsourcefile
from pathlib import Path
from typing import Any

from visenvs.core.config import Config
from visenvs.core.lanes import Task
from visenvs.core.layout import Choices, Layout
from visenvs.core.registry import environment_files, laws, load_task

DOCS = Path(__file__).resolve().parent
OUT = DOCS / "generated"
REPRODUCTION = DOCS / "reproduction.json"
ESTIMATION = DOCS.parent / "visenvs" / "estimation"
CASES = {  # of `eval.reproduce`, where a published figure can be compared with ours
    "Rendezvous-v0": ("rendezvous", "lq-gains"),
    "Tracking2D-v0": ("table2", "table3", "table4", "table5", "fig47", "fig50"),
    "Avoidance-v0": (
        *("fig25", "fig27", "fig30", "fig34", "fig44"),
        *("iisc-2", "iisc-3", "iisc-4", "iisc-5", "iisc-sigma"),
    ),
    "Formation-v0": ("fig7", "fig8", "fig10", "fig11", "gtmax", "gtyak", "string", "leader", "ukf"),
    "Mapping-v0": ("fig15", "fig16", "fig18", "fig19"),
    "Herding-v0": ("iarc-fig3", "ncc", "iarc-fig5", "iarc-fig7", "ddp", "vio", "ud"),
}


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("builder-inited", lambda _app: write())
    return {"parallel_read_safe": True}


def write() -> None:
    """Write all pages; a page whose text has not changed is left alone, so Sphinx skips it."""
    pages: dict[str, str] = {}
    for env_id, module in environment_files().items():
        task = load_task(env_id)
        pages[f"environments/{slug(env_id)}"] = environment(task, module)
    for path in sorted(ESTIMATION.glob("[!_]*.py")):
        pages[f"estimators/{path.stem}"] = module_page(path)
    pages["laws"] = law_page()
    pages["reproduction"] = reproduction_page()
    pages["environments/index"] = contents(
        "Environments", [slug(env) for env in environment_files()]
    )
    names = [path.stem for path in sorted(ESTIMATION.glob("[!_]*.py"))]
    pages["estimators/index"] = contents("Estimators", names)
    for name, text in pages.items():
        path = OUT / f"{name}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def slug(env_id: str) -> str:
    """`visenvs/Rendezvous-v0` -> `Rendezvous-v0`."""
    return env_id.rpartition("/")[2]


def contents(title: str, names: list[str]) -> str:
    """A page that lists others."""
    listed = "\n".join(names)
    return f"# {title}\n\n```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"


def environment(task: Task, module: str) -> str:
    """The page of one environment."""
    text, first = getdoc(import_module(module)) or "", next(iter(task.scenarios))
    config = type(next(iter(task.scenarios.values())))
    parts = [
        f"# {slug(task.id)}",
        text,
        picture(task),
        f'```python\nenv = gymnasium.make("{task.id}", scenario="{first}")\n```',
        "## Observation",
        *(f"With `observation={name!r}`:\n\n{view.table()}" for name, view in observations(task)),
        "## Action",
        *(f"{name}{action_text(action)}" for name, action in actions(task)),
        "## Reward",
        "Minus the increase of the cost, in the terms "
        + ", ".join(f"`{name.removeprefix('cost_')}`" for name in task.costs)
        + ". At the end of an episode `info['metrics']` holds "
        + ", ".join(
            f"`{name}`" + (f" ({unit})" if unit else "") for name, unit in task.metrics.items()
        )
        + ".",
        f"The leaderboard compares with `{task.reference}`.",
        published(slug(task.id)),
        "## Scenarios",
        scenarios(task),
        "## Settings",
        "Any of these can be given to `gymnasium.make` by name.",
        settings(config),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def picture(task: Task) -> str:
    """A moving picture of a flight, if the documents have one."""
    stem = task.picture.partition(":")[0].rpartition(".")[2].replace("_", "-")
    name = f"{stem}.webp"  # of `eval.gallery`
    return f"![A flight](../../{name})" if (DOCS / name).exists() else ""


def observations(task: Task) -> Iterator[tuple[str, Any]]:
    """Every view of a task by its name."""
    yield from task.views.items() or [("belief", task.observation)]


def actions(task: Task) -> Iterator[tuple[str, Layout | Choices]]:
    """Every kind of action, with an introduction where there are several."""
    yield "", task.action
    for name, action in task.modes.items():
        yield f"With `action_mode={name!r}`:\n\n", action


def action_text(action: Layout | Choices) -> str:
    """What an action is."""
    if isinstance(action, Layout):
        return action.table()
    listed = ", ".join(f"`{name}`" for name in action.names)
    text = f"The number of one of {len(action.names)} choices: {listed}."
    told = f" `{action.mask}` in the row, and `info['action_mask']`, tell which may be taken."
    return text + (told if action.mask else "")


def scenarios(task: Task) -> str:
    """Each preset, and in what it differs from the first."""
    first, *others = task.scenarios.items()
    lines = ["| scenario | differs in |", "|---|---|", f"| `{first[0]}` (default) | |"]
    for name, preset in others:
        changed = ", ".join(
            f"`{field.name} = {cell(getattr(preset, field.name))}`"
            for field in dataclasses.fields(preset)  # type: ignore[arg-type]
            if getattr(preset, field.name) != getattr(first[1], field.name, None)
        )
        lines.append(f"| `{name}` | {changed} |")
    return "\n".join(lines)


def settings(config: type[Config]) -> str:
    """Every field of a configuration with its default and its comment."""
    said = comments(config)
    lines = ["| setting | default | what |", "|---|---|---|"]
    for field in dataclasses.fields(config):  # type: ignore[arg-type]
        lines.append(f"| `{field.name}` | `{cell(field.default)}` | {said.get(field.name, '')} |")
    return "\n".join(lines)


def cell(value: Any) -> str:
    """A value, short, as it may stand in a table."""
    return f"{value:.6g}" if isinstance(value, float) else str(value).replace("|", "/")


def comments(config: type[Any]) -> dict[str, str]:
    """The comment at the end of each field's line, of a dataclass and those it stands on."""
    found: dict[str, str] = {}
    for owner in reversed(config.__mro__[:-1]):
        source = getsourcefile(owner)
        if source is None:
            continue
        text = Path(source).read_text(encoding="utf-8")
        remarks = {
            token.start[0]: token.string.lstrip("# ")
            for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type == tokenize.COMMENT
        }
        for node in ast.parse(text).body:
            if isinstance(node, ast.ClassDef) and node.name == owner.__name__:
                for item in node.body:
                    if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
                        remark = remarks.get(item.end_lineno or 0, "").replace("|", "\\|")
                        found[item.target.id] = remark
    return found


def module_page(path: Path) -> str:
    """A module: its docstring, and what its public functions say of themselves."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    parts = [f"# {path.stem}", ast.get_docstring(tree) or ""]
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            arguments = ", ".join(argument.arg for argument in node.args.args)
            parts.append(f"## `{node.name}({arguments})`")
            parts.append(f"```text\n{ast.get_docstring(node) or ''}\n```")
    return "\n\n".join(parts) + "\n"


def law_page() -> str:
    """All laws with their sources and what they read."""
    lines = ["# Guidance laws", "Families with a number or words in their names show one member."]
    for name, law in sorted(laws().items()):
        lines += [
            f"## `{name}`",
            f"{law.summary}. Source: {law.source}.",
            f"Reads {code_list(law.needs)}; settings {code_list(law.settings)}.",
        ]
    return "\n\n".join(lines) + "\n"


def code_list(names: tuple[str, ...]) -> str:
    """Names in code style, or "none"."""
    return ", ".join(f"`{name}`" for name in names) or "none"


def published(environment: str) -> str:
    """The published figures of one environment beside ours; empty where there are none."""
    chosen = [row for row in recorded()["rows"] if row["id"].split("/")[0] in of(environment)]
    if not chosen:
        return ""
    what = "The papers' figures beside ours, SI unless a name ends in another unit"
    return f"## Published and ours\n\n{what} ([all](../reproduction.md)).\n\n{figures(chosen)}"


def of(environment: str) -> tuple[str, ...]:
    """The cases of an environment."""
    return CASES.get(environment, ())


def recorded() -> dict[str, Any]:
    """The last recorded run of `eval.reproduce`."""
    if not REPRODUCTION.exists():
        return {"rows": [], "meta": {}}
    return json.loads(REPRODUCTION.read_text(encoding="utf-8"))


def reproduction_page() -> str:
    """Paper against ours, from the last recorded run of `eval.reproduce`."""
    found = recorded()
    made = found["meta"]
    lines = [
        "# Reproduction",
        "Paper against ours. An empty verdict is a figure that is only reported.",
        f"`{made.get('command')}`, commit `{made.get('commit')}`, {made.get('date')}.",
        figures(found["rows"]),
    ]
    return "\n\n".join(lines) + "\n"


def figures(rows: list[dict[str, Any]]) -> str:
    """A table of rows of `eval.reproduce`."""
    lines = [
        "| row | paper | ours | standard error | runs | accepted | |",
        "|---|---:|---:|---:|---:|---|---|",
    ]
    for row in rows:
        band = "" if row["ok"] is None else f"{end(row['low'], '-∞')} to {end(row['high'], '∞')}"
        verdict = {True: "ok", False: "off", None: ""}[row["ok"]]
        cells = [number(row[key]) for key in ("paper", "ours", "se", "n")]
        lines.append(f"| `{row['id']}` | {' | '.join(cells)} | {band} | {verdict} |")
    return "\n".join(lines)


def end(value: Any, open_end: str) -> str:
    """One end of a band."""
    return open_end if value is None else number(value)


def number(value: Any) -> str:
    """A figure of the table; empty for none."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
