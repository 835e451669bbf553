"""The view of a mechanism in a notebook: one piece of HTML that needs nothing else."""

from __future__ import annotations

from html import escape

from leastaction.errors import some
from leastaction.mechanics.mechanism.compilation import Plan
from leastaction.mechanics.mechanism.view import MOST_NAMES, Row, element_lines, name_lines, shared_variables, tree_rows

# Text has the notebook's own colour and everything else is a tint of it, or of a hue that reads on both
# a light and a dark ground, so no theme has to be guessed.
_STYLE = """
.leastaction{font:13px/1.5 system-ui,sans-serif;color:inherit;max-width:100%}
.leastaction header{font-weight:600;margin:0 0 .4em}
.leastaction header span{font-weight:400;opacity:.65;margin-left:.6em}
.leastaction .rows{font:12.5px/1.55 ui-monospace,Menlo,Consolas,monospace;overflow-x:auto;white-space:nowrap;
padding:.4em .7em;border:1px solid rgba(128,128,128,.35);border-radius:6px}
.leastaction .rows div{white-space:pre}
.leastaction .branch,.leastaction .soft{opacity:.55}
.leastaction .frame{font-weight:600}
.leastaction .pill{display:inline-block;white-space:pre;border-radius:9px;padding:0 .55em;margin:0 .3em .15em 0}
.leastaction .rows .pill{margin:0 0 0 .6em;line-height:1.35}
.leastaction .dynamic{background:rgba(46,134,222,.2)}
.leastaction .kinematic{background:rgba(230,145,20,.25)}
.leastaction .inputs{background:rgba(38,170,100,.22)}
.leastaction .constraints{background:rgba(170,90,210,.2)}
.leastaction .mass{background:rgba(128,128,128,.2)}
.leastaction details{margin:.45em 0 0}
.leastaction summary{cursor:pointer;font-weight:600}
.leastaction summary span{font-weight:400;opacity:.65}
.leastaction dl{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:.15em .9em;margin:.3em 0 0 1em}
.leastaction dt{opacity:.75}
.leastaction dd{margin:0;overflow-wrap:anywhere}
""".replace("\n", "")


def html_view(plan: Plan) -> str:
    """Return a mechanism as HTML: the tree with variables and masses, the elements, the names.

    ``plan``: the checked mechanism. Returns one ``div`` with its own style; no script, nothing is loaded.
    """
    frames = plan.tree.frames
    rows, left_out = tree_rows(plan.tree)
    counts = [(len(frames), "frames"), *((len(names), kind) for kind, names in name_lines(plan))]
    sizes = ", ".join(f"{count} {kind.removesuffix('s') if count == 1 else kind}" for count, kind in counts if count)
    parts = [
        f'<div class="leastaction"><style>{_STYLE}</style>',
        f"<header>Mechanism<span>{sizes}</span></header>",
        f'<div class="rows"><div><span class="frame">{escape(frames[0].name)}</span></div>',
        *map(_row, rows),
    ]
    if left_out:
        parts.append(f'<div class="soft">… and {left_out} more</div>')
    parts.append("</div>")
    elements = element_lines(plan)
    if elements:
        entries = [
            (f"{escape(title)}{f' <b>{escape(name)}</b>' if name else ''}", escape(description))
            for title, name, description in elements
        ]
        parts.append(_section("elements", len(elements), entries))
    if plan.numbers:
        numbers = [(escape(name), f"{value:g}") for name, value in plan.numbers.items()]
        parts.append(_section("changed numbers", len(numbers), numbers))
    shared = shared_variables(plan.tree)
    if shared:
        couplings = [(escape(name), escape(some(f))) for name, f in shared.items()]
        parts.append(_section("variables that move several frames", len(shared), couplings))
    for kind, names in name_lines(plan):
        if names:
            parts.append(
                f"<details><summary>{kind} <span>({len(names)})</span></summary>"
                f'<div style="margin:.3em 0 0 1em">{_pills(kind, names)}</div></details>'
            )
    parts.append("</div>")
    return "".join(parts)


def _row(row: Row) -> str:
    text = [f'<span class="branch">{escape(row.branch)}</span><span class="frame">{escape(row.name)}</span>']
    if row.transform:
        text.append(f"  {escape(row.transform)}")
    if row.detail:
        text.append(f'  <span class="soft">{escape(row.detail)}</span>')
    if row.kinematic:
        text.append(_pills("kinematic", (row.kinematic,)))
    if row.bodies:
        text.append(_pills("mass", row.bodies))
    return f"<div>{''.join(text)}</div>"


def _section(title: str, count: int, entries: list[tuple[str, str]]) -> str:
    shown = "".join(f"<dt>{term}</dt><dd>{text}</dd>" for term, text in entries[:MOST_NAMES])
    more = len(entries) - MOST_NAMES
    rest = f'<dt class="soft">… and {more} more</dt>' if more > 0 else ""
    return f"<details open><summary>{title} <span>({count})</span></summary><dl>{shown}{rest}</dl></details>"


def _pills(kind: str, names: tuple[str, ...]) -> str:
    shown = "".join(f'<span class="pill {kind}">{escape(name)}</span>' for name in names[:MOST_NAMES])
    more = len(names) - MOST_NAMES
    return shown + (f'<span class="soft">… and {more} more</span>' if more > 0 else "")
