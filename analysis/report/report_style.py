"""The report's style sheet: system fonts, readable in grey, on a phone and printed."""

from typing import Final

STYLE: Final = """
:root { --line: #d0d7de; --soft: #57606a; --tint: #f6f8fa; --link: #0550ae;
  --claim: #6639ba; --claim-tint: #f8f5fe; --missed: #9a5b00; --missed-tint: #fdf7ea; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1f2328; background: #fff;
  max-width: 62rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: .5rem 0; }
h2 { font-size: 1.3rem; line-height: 1.3; margin: 2.5rem 0 .75rem; }
h3 { font-size: 1.1rem; margin: 0 0 .25rem; }
a { color: var(--link); }
code, pre { font: .875em/1.5 ui-monospace, monospace; }
pre { background: var(--tint); border: 1px solid var(--line); padding: .5rem .75rem;
  white-space: pre-wrap; overflow-wrap: anywhere; margin: 0; }
table { border-collapse: collapse; width: 100%; margin: .75rem 0; font-size: .95rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .6rem;
  border-bottom: 1px solid var(--line); }
th { font-weight: 600; }
thead th { color: var(--soft); border-bottom-width: 2px; }
.number { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
.plain td { overflow-wrap: anywhere; }
nav table { max-width: 46rem; }
nav .paper th { padding-top: .9rem; }
article { border-top: 1px solid var(--line); padding: 1.25rem 0 .5rem; }
.figure, .fine, .back, figcaption { color: var(--soft); }
.figure { font-weight: 400; }
.fine, .back, figcaption { font-size: .85rem; }
.total { font-size: 1.1rem; }
.checks td { font-variant-numeric: tabular-nums; }
.checks td:nth-child(2), .checks td:nth-child(3), .verdict { white-space: nowrap; }
.checks .noted td { border-bottom: 0; padding-bottom: 0; }
.checks .note td { color: var(--soft); font-size: .9rem; padding-top: .1rem; }
.does_not_hold { --mark: var(--claim); --tint: var(--claim-tint); }
.not_reached { --mark: var(--missed); --tint: var(--missed-tint); }
.does_not_hold .verdict, .not_reached .verdict, strong { color: var(--mark); font-weight: 700; }
.does_not_hold .verdict, .not_reached .verdict { border: 2px solid; padding: 0 .3rem; }
.checks .does_not_hold td:first-child, .checks .not_reached td:first-child {
  border-left: 5px solid var(--mark); }
.checks .does_not_hold td, .checks .not_reached td { background: var(--tint); }
.different, .missing, .unreadable { border-left: 5px solid var(--soft); padding-left: .75rem; }
figure { margin: 1rem 0; }
figure img { display: block; max-width: 100%; height: auto; }
figure.chart img { width: 100%; max-width: 52rem; }
details { margin: .5rem 0; }
summary { cursor: pointer; }
@media (max-width: 44rem) {
  body { padding: .75rem; }
  .checks thead { display: none; }
  .checks, .checks tbody, .checks tr, .checks td { display: block; width: 100%; }
  .checks tr { border-bottom: 1px solid var(--line); padding: .4rem 0; }
  .checks tr.noted { border-bottom: 0; padding-bottom: 0; }
  .checks td { border: 0; padding: .05rem .6rem; }
  .checks td[data-label] { display: flex; }
  .checks td[data-label]::before { content: attr(data-label); flex: 0 0 6rem;
    color: var(--soft); }
  .checks .does_not_hold, .checks .not_reached {
    border-left: 5px solid var(--mark); background: var(--tint); }
  .checks .does_not_hold td:first-child, .checks .not_reached td:first-child { border-left: 0; }
  figure.chart { overflow-x: auto; }
  figure.chart img { width: 40rem; max-width: none; }
}
@media print {
  body { font-size: 10.5pt; max-width: none; padding: 0; }
  figure, .checks tr { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
  .noted { break-after: avoid; }
  .back { display: none; }
  * { print-color-adjust: exact; }
}
"""
