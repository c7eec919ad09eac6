"""The style sheet of a design's page: on a screen readable, on paper one sheet of A4."""

from typing import Final

STYLE: Final = """
@page { size: A4; margin: 9mm 10mm; }
:root { --line: #d0d7de; --soft: #57606a; --tint: #f6f8fa; --certain: #1b4f9c;
  --likely: #8a6100; --no: #b5482a; }
* { box-sizing: border-box; print-color-adjust: exact; -webkit-print-color-adjust: exact; }
body { font: 14px/1.4 system-ui, sans-serif; color: #1f2328; background: #fff;
  max-width: 62rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.5em; line-height: 1.2; margin: 0 0 .2em; }
h3 { font-size: 1.05em; margin: .9em 0 .2em; }
p { margin: .2em 0; }
code, pre { font: .9em/1.4 ui-monospace, monospace; }
pre { background: var(--tint); border: 1px solid var(--line); padding: .3em .5em; margin: 0;
  white-space: pre-wrap; overflow-wrap: anywhere; }
table { border-collapse: collapse; width: 100%; font-size: .93em; }
th, td { text-align: left; vertical-align: top; padding: .18em .5em .18em 0;
  border-bottom: 1px solid var(--line); }
th { color: var(--soft); font-weight: 600; border-bottom-width: 2px; }
.number { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
.links td:nth-child(7) { white-space: nowrap; }
.links td:nth-child(6) { min-width: 4em; }
.links td:last-child { color: var(--soft); font-size: .88em; width: 42%; }
.limits td { background: var(--tint); }
.limits td:first-child { font-weight: 700; border-left: 4px solid #1f2328; padding-left: .4em; }
.outside .bar i { background: var(--no); }
.outside .number, .outside .share { color: var(--no); font-weight: 600; }
.bar { display: inline-block; position: relative; width: 5.5em; height: .75em;
  background: linear-gradient(90deg, transparent calc(50% - .5px), #1f2328 0,
  #1f2328 calc(50% + .5px), transparent 0) var(--tint); border: 1px solid var(--line); }
.bar i { position: absolute; top: 0; bottom: 0; background: var(--certain); }
.share { display: inline-block; min-width: 4em; text-align: right;
  font-variant-numeric: tabular-nums; }
.verdict { display: flex; gap: 1.2em; align-items: center; border: 3px solid var(--mark);
  padding: .4em .8em; margin: .6em 0; }
.verdict h2 { font-size: 2em; margin: 0; color: var(--mark); min-width: 4em;
  text-align: center; }
.certain { --mark: var(--certain); }
.likely { --mark: var(--likely); }
.no { --mark: var(--no); }
.beside { display: grid; grid-template-columns: 3fr 2fr; gap: 1.2em; }
.beside section { min-width: 0; }
.warning { border: 2px solid var(--no); color: var(--no); font-weight: 700; padding: .2em .5em; }
ul { margin: .2em 0; padding-left: 1.2em; }
figure { margin: .3em 0; }
figure img { display: block; width: 100%; max-height: 24rem; height: auto; }
.fine, figcaption, footer { color: var(--soft); font-size: .88em; }
footer { margin-top: .8em; }
@media screen and (max-width: 44rem) {
  .beside, .verdict { display: block; }
  .links td:last-child, .links th:last-child { display: none; }
}
@media print {
  body { font-size: 7.3pt; line-height: 1.3; max-width: none; padding: 0; }
  figure img { max-height: 62mm; }
  th, td { padding: .1em .5em .1em 0; }
  tr, section.verdict, figure { break-inside: avoid; }
}
"""
