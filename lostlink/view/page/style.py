"""Colours and places of the page, for light and dark; prefers-color-scheme decides unless the viewer does."""

from __future__ import annotations

from typing import Final

from lostlink.view.page.charts import SERIES_COLOURS, STEPS

_LIGHT: Final = (
    "--ll-ink:#1c2733;--ll-faint:#dde3e9;--ll-accent:#2b7bba;--ll-loss:#b3001b;--ll-ground:#fbfcfd;"
    "--ll-panel:#ffffff;--ll-page:#eef1f4;--ll-line:#c5ced7;--ll-bar:#22384d;--ll-plan:#8a5a00;"
    "--ll-button:#1f6aa5;"
)
_DARK: Final = (
    "--ll-ink:#e4e9ee;--ll-faint:#2b343d;--ll-accent:#6fb3e8;--ll-loss:#ff6b7d;--ll-ground:#12171c;"
    "--ll-panel:#1a2027;--ll-page:#0d1115;--ll-line:#3a444e;--ll-bar:#16222e;--ll-plan:#f0b84a;"
    "--ll-button:#6fb3e8;"
)
CSS: Final = f"""
body {{ {_LIGHT} --ll-steps:{",".join(STEPS)}; --ll-nodes:{",".join(SERIES_COLOURS)};
  --q-primary:var(--ll-button) !important; background:var(--ll-page); color:var(--ll-ink); }}
body.body--dark {{ {_DARK} background:var(--ll-page); }}
@layer quasar_importants {{ /* its `!important` stands over that of later layers, and of none */
  body.body--dark .bg-primary {{ color:var(--ll-ground) !important; }}
  .q-btn:focus-visible, .q-checkbox:focus-visible {{ outline:2px solid var(--ll-accent) !important; }}
}}
.nicegui-content {{ padding:0; gap:0; height:100vh; flex-wrap:nowrap; }}
.ll-bar {{ background:var(--ll-bar); color:#fff; padding:6px 14px; gap:16px; align-items:center; flex-wrap:wrap; }}
.ll-bar h1 {{ font-size:1rem; line-height:1.4; margin:0; font-weight:600; }}
.ll-time {{ font-variant-numeric:tabular-nums; }}
.ll-main {{ display:grid; grid-template-columns:minmax(0,3fr) minmax(0,2fr); gap:8px; padding:8px; width:100%;
  flex:1; min-height:520px; }}
.ll-panel {{ background:var(--ll-panel); border:1px solid var(--ll-line); border-radius:6px; display:flex;
  flex-direction:column; min-height:0; min-width:0; overflow:hidden; }}
.ll-tools {{ display:flex; flex-wrap:wrap; gap:4px 10px; padding:6px 10px; align-items:center;
  border-bottom:1px solid var(--ll-line); }}
.ll-scene {{ flex:1; min-height:0; }}
.ll-scene > * {{ width:100%; height:100%; }}
.ll-place {{ flex:1; min-width:120px; accent-color:var(--ll-accent); }}
.ll-scale {{ display:inline-flex; gap:8px; align-items:center; }}
.ll-legend {{ display:inline-block; width:120px; height:10px; border-radius:3px;
  background:linear-gradient(90deg,{",".join(STEPS)}); }}
.ll-chart {{ flex:1; min-height:260px; width:100%; }}
.ll-tab {{ display:flex; flex-direction:column; gap:8px; width:100%; height:100%; padding:10px; }}
.ll-panel .q-tab-panels {{ flex:1; min-height:0; background:transparent; color:inherit; }}
.ll-panel .q-tab-panel {{ padding:0; height:100%; overflow:auto; }}
.ll-said {{ flex:none; height:22%; min-height:90px; overflow:auto; padding:6px 10px;
  display:flex; flex-direction:column-reverse; /* stays at its newest line, unless it is scrolled away */
  border-top:1px solid var(--ll-line); font-size:.85rem; }}
.ll-said ol {{ list-style:none; margin:0 0 auto; padding:0; }}
.ll-panel .q-tab {{ padding:0 5px; min-width:0; flex:none; }}
.ll-panel .q-tabs__content {{ flex-wrap:wrap; }}
.q-table__container {{ background:transparent; color:inherit; }}
.q-table tbody td {{ font-variant-numeric:tabular-nums; }}
.q-table--dense th, .q-table--dense td {{ padding:2px 5px !important; }}
.ll-tab .q-table th, .ll-tab .q-table td {{ white-space:normal; }}
.ll-tab .q-table th:not(.sorted) .q-table__sort-icon {{ display:none; }} /* it takes room that columns need */
.ll-tab .nicegui-table {{ width:100%; max-height:100%; }}
.ll-tab .ll-long {{ max-height:50vh; }} /* what is below a fleet of many rows stays in sight */
.ll-long thead th {{ position:sticky; top:0; z-index:1; background:var(--ll-panel); }}
.ll-words {{ font-size:.9rem; }}
.ll-emergency, .ll-alert, .ll-critical, .ll-error {{ color:var(--ll-loss); font-weight:600; }}
.ll-warning {{ font-weight:600; }}
*:focus-visible, .q-field--focused {{ outline:2px solid var(--ll-accent); outline-offset:1px; }}
@media (max-width: 900px) {{ .nicegui-content {{ height:auto; }}
  .ll-main {{ grid-template-columns:minmax(0,1fr); flex:none; }} .ll-said {{ height:180px; }}
  .ll-scene {{ flex:none; height:clamp(240px,65vh,420px); }} .ll-chart {{ flex:none; height:340px; }} }}
"""
