"""The page's style sheet: one column on a phone, light or dark as the reader has it, black on white in print."""

CSS = """
:root { color-scheme: light dark; --ink: #1b1f24; --soft: #57606a; --paper: #ffffff; --panel: #f5f6f8;
  --line: #d5d9df; --accent: #0b5cad; --warn: #8a4b00; --warn-paper: #fff4e0; --good: #1a6b3c; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e8eb; --soft: #a2abb6; --paper: #14171b; --panel: #1f242a; --line: #3a424c; --accent: #7cb7f2;
    --warn: #f3c27a; --warn-paper: #33270f; --good: #7fd3a0; }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0 auto; padding: 1rem clamp(.75rem, 3vw, 2rem) 3rem; max-width: 74rem; background: var(--paper);
  color: var(--ink); font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: .5rem 0; overflow-wrap: anywhere; }
h2 { font-size: 1.3rem; margin: 2.5rem 0 .25rem; padding-top: .75rem; border-top: 2px solid var(--line);
  overflow-wrap: anywhere; }
h3 { font-size: 1.05rem; margin: 1.75rem 0 .5rem; }
p { margin: .4rem 0; }
a { color: var(--accent); }
.soft, figcaption, caption { color: var(--soft); font-size: .9rem; }
.notice { margin: .9rem 0; padding: .6rem .9rem; border-left: 4px solid var(--warn); background: var(--warn-paper);
  border-radius: 0 .3rem .3rem 0; }
.notice h3 { margin: 0 0 .2rem; color: var(--warn); }
.notice ul { margin: 0; padding-left: 1.2rem; }
.notice li { margin: .25rem 0; overflow-wrap: anywhere; }
.fine { color: var(--good); }
.wide { overflow-x: auto; margin: .5rem 0; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { padding: .28rem .7rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th[scope=row] { text-align: left; font-weight: 500; }
thead th { text-align: right; color: var(--soft); font-weight: 600; vertical-align: bottom; }
thead th:first-child { text-align: left; }
table.words td { text-align: left; white-space: normal; min-width: 12rem; }
table.words th[scope=row] { vertical-align: top; }
table.dense { font-size: .86rem; }
table.dense th, table.dense td { padding: .28rem .38rem; }
table.dense td:last-child, table.dense th:last-child { text-align: left; }
table.dense td:last-child { white-space: normal; min-width: 8rem; }
.figures { display: grid; gap: 1rem; grid-template-columns: repeat(auto-fit, minmax(min(100%, 19rem), 1fr)); }
figure { margin: 0; padding: .6rem; background: var(--panel); border: 1px solid var(--line); border-radius: .4rem; }
figure img { display: block; width: 100%; max-width: 30rem; height: auto; margin: 0 auto; background: #fff;
  border-radius: .2rem; }
figcaption { margin-top: .4rem; }
details { margin: .6rem 0; border: 1px solid var(--line); border-radius: .4rem; padding: .4rem .8rem; }
summary { cursor: pointer; font-weight: 600; }
pre { overflow-x: auto; font-size: .82rem; line-height: 1.4; margin: .5rem 0; }
footer { margin-top: 3rem; border-top: 1px solid var(--line); padding-top: .5rem; }
@media (max-width: 40rem) {
  th, td { padding: .25rem .45rem; }
  th[scope=row] { white-space: normal; min-width: 6.5rem; }
  table.words, table.words tbody, table.words tr, table.words th, table.words td { display: block; width: 100%; }
  table.words th, table.words td { border: 0; padding: .05rem 0; min-width: 0; }
  table.words tr { padding: .35rem 0; border-bottom: 1px solid var(--line); }
  table.words td { padding-left: .9rem; overflow-wrap: anywhere; }
}
@media print {
  :root { color-scheme: light; --ink: #000; --soft: #333; --paper: #fff; --panel: #fff; --line: #999; --accent: #000;
    --warn: #000; --warn-paper: #fff; --good: #000; }
  @page { margin: 15mm; }
  body { max-width: none; padding: 0; font-size: 9.5pt; }
  .figures { grid-template-columns: 1fr 1fr; }
  figure, tr, .notice { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
  section + section.run { break-before: page; }
  .wide { overflow: visible; }
  th, td { padding: .15rem .4rem; }
  pre { white-space: pre-wrap; }
  details::details-content { display: block; content-visibility: visible; block-size: auto; }
}
"""
