"""The page's style sheet: light and dark by the reader's own setting, ink on white when printed."""

from sense4hri.modalities import colour_variables

LIGHT = """--page:#f3f5f8;--panel:#fff;--raised:#f3f6f9;--line:#dbe1e8;--text:#15202b;--muted:#5a6878;--grid:#e6eaef;
--track:#eef1f5;--hole:#f3b9a5;--ok:#0a7a43;--wait:#8a5a00;--bad:#b93a10;--marker:#a34d00;--accent:#0f766e;
--shadow:0 1px 2px rgb(20 32 43/6%),0 6px 24px rgb(20 32 43/5%);
color-scheme:light;"""

DARK = """--page:#0a0e13;--panel:#11171f;--raised:#19212c;--line:#222c39;--text:#e8eef5;--muted:#8e9bad;--grid:#1c2632;
--track:#19212c;--hole:#7d3a26;--ok:#4fd18b;--wait:#ffc24b;--bad:#ff8660;--marker:#ffb454;--accent:#2dd4bf;
--shadow:none;color-scheme:dark;"""

STYLE = f"""
:root{{{LIGHT}{colour_variables(dark=False)}}}
@media (prefers-color-scheme:dark){{:root{{{DARK}{colour_variables(dark=True)}}}}}
@media print{{:root{{{LIGHT}{colour_variables(dark=False)}--page:#fff;--shadow:none;}}}}
"""
STYLE += """
*{box-sizing:border-box}
html{-webkit-print-color-adjust:exact;print-color-adjust:exact}
body{margin:0;background:var(--page);color:var(--text);font:14px/1.5 "Inter","Segoe UI",system-ui,-apple-system,
"Helvetica Neue","DejaVu Sans",Arial,sans-serif;font-variant-numeric:tabular-nums}
main{max-width:1220px;margin:0 auto;padding:28px 20px 60px}
h1{font-size:25px;line-height:1.2;margin:0;letter-spacing:-.02em;overflow-wrap:anywhere}
h2{font-size:17px;margin:38px 0 12px;letter-spacing:-.01em}
h3{font-size:15px;margin:0;overflow-wrap:anywhere}
p{margin:0}
.over{color:var(--muted);font-size:12.5px;margin-bottom:3px;overflow-wrap:anywhere}
.panel{background:var(--panel);border:1px solid var(--line);border-radius:12px;padding:16px 18px;
box-shadow:var(--shadow)}
.panel+.panel{margin-top:14px}
.verdict{display:grid;grid-template-columns:auto 1fr;gap:4px 16px;align-items:center;margin:18px 0 14px;
border-left:6px solid var(--v);padding:16px 20px}
.verdict .sign{font-size:34px;line-height:1;color:var(--v);grid-row:span 2}
.verdict strong{font-size:20px;color:var(--v);letter-spacing:-.01em}
.verdict p{overflow-wrap:anywhere}
.complete{--v:var(--ok)}.gaps{--v:var(--wait)}.broken{--v:var(--bad)}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:12px 18px}
.facts div{min-width:0}
.facts dt{color:var(--muted);font-size:12px}
.facts dd{margin:0;font-weight:600;overflow-wrap:anywhere}
dl{margin:0}
ul.said{margin:8px 0 0;padding:0 0 0 18px}
ul.said li{overflow-wrap:anywhere}
ul.said.remarks{color:var(--muted)}
.chip{display:inline-flex;gap:6px;align-items:baseline;color:var(--v);font-weight:600;white-space:nowrap}
.wide{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:13px}
th{color:var(--muted);font-weight:500;text-align:left;white-space:nowrap;font-size:12px}
th,td{padding:6px 12px 6px 0;border-bottom:1px solid var(--line);vertical-align:top;overflow-wrap:anywhere}
tr:last-child td{border-bottom:0}
td.n,th.n{text-align:right;white-space:nowrap}
td.t{white-space:nowrap}
td.fill{width:100%;min-width:200px}
td.stream-name{min-width:215px}
td.zero{color:var(--muted)}
td.hit{color:var(--bad);font-weight:600}
td code,dd code{font-size:12px}
code{font-family:ui-monospace,"SFMono-Regular","DejaVu Sans Mono",Menlo,monospace;overflow-wrap:anywhere}
.dot{display:inline-block;width:9px;height:9px;border-radius:3px;background:var(--c);margin-right:8px}
a{color:inherit;text-decoration-color:var(--line);text-underline-offset:3px}
svg{display:block;width:100%;min-width:760px;height:auto;font-size:11px}
svg text{fill:var(--text)} svg .tick,svg .small{fill:var(--muted);font-size:10.5px}
svg .name{font-size:12px;font-weight:600} svg .lane{font-size:11px}
svg .marks{fill:var(--marker);font-size:10.5px}
.grid{stroke:var(--grid);stroke-width:1}
.rule{stroke:var(--line);stroke-width:1}
.track{fill:var(--track)} .outside{fill:var(--page);opacity:.62}
.data{fill:var(--c)}
.hole{fill:var(--hole)} .holeline{fill:var(--bad);opacity:.16}
.never{fill:none;stroke:var(--bad);stroke-dasharray:4 4}
.reset{fill:var(--bad);stroke:var(--panel);stroke-width:1.5}
.odd{fill:var(--wait);stroke:var(--panel);stroke-width:1.5}
.marker{stroke:var(--marker);stroke-width:1;opacity:.75}
.edge{stroke:var(--text);stroke-width:1.4}
.step{stroke:var(--bad);stroke-width:1.4;stroke-dasharray:5 3}
.wave{fill:none;stroke:var(--c);stroke-width:1.1;stroke-linejoin:round}
.curve{fill:none;stroke:var(--c);stroke-width:1.5;stroke-linejoin:round;stroke-linecap:round}
.band{fill:var(--c);opacity:.2}
.offskin{fill:var(--wait)}
.key{display:flex;flex-wrap:wrap;gap:4px 18px;color:var(--muted);font-size:12px;margin-top:8px}
.key i{display:inline-block;width:14px;height:9px;border-radius:2px;margin-right:6px;background:var(--c)}
.head{display:flex;flex-wrap:wrap;gap:4px 14px;align-items:baseline;justify-content:space-between;margin-bottom:4px}
.stream .facts{margin:12px 0 4px;grid-template-columns:repeat(auto-fit,minmax(128px,1fr));gap:8px 16px}
.stream .facts dd{font-weight:500}
.stream .plot{margin-top:10px}
details{margin-top:12px}
summary{cursor:pointer;color:var(--muted);font-size:13px}
summary:hover{color:var(--text)}
.foot{margin-top:40px;color:var(--muted);font-size:12.5px}
.muted{color:var(--muted)}
:focus-visible{outline:2px solid var(--accent);outline-offset:2px}
@media print{
 @page{margin:12mm}
 main{max-width:none;padding:0} body{font-size:11px} svg{min-width:0} .wide{overflow:visible}
 .panel{border-color:#ccd} .stream,.timeline,tr{break-inside:avoid} h2,h3{break-after:avoid} summary{display:none}
}
"""
