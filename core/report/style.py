"""Look of the report: light and dark, screen and A4 paper."""

STYLE = """
:root {
  color-scheme: light dark;
  --paper: #fbfaf7; --ink: #23211e; --soft: #6b665e; --line: #dcd7cc; --panel: #f2efe8;
  --good: #1e6b3a; --warn: #8a5a00; --bad: #a1261c; --drawn: #b87a00; --projected: #1f5fd0;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #191817; --ink: #ece8e1; --soft: #a8a297; --line: #3a3733; --panel: #232120;
    --good: #7fce9a; --warn: #e8b65a; --bad: #f09088; --drawn: #f0a000; --projected: #7aa7ff;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0 auto; padding: 2.5rem 1.5rem 4rem; max-width: 74rem; background: var(--paper); color: var(--ink);
  font: 16px/1.5 "Source Sans 3", "Segoe UI", system-ui, -apple-system, "Noto Sans", sans-serif;
}
h1 { font: 600 2.1rem/1.15 Georgia, "Noto Serif", serif; margin: 0 0 .25rem; overflow-wrap: anywhere; }
h2 { font: 600 1.3rem/1.2 Georgia, "Noto Serif", serif; margin: 2.6rem 0 .8rem; }
p { margin: .4rem 0; max-width: 46rem; }
.soft, caption, figcaption { color: var(--soft); }
.facts {
  display: grid; grid-template-columns: repeat(auto-fill, minmax(13rem, 1fr)); gap: .6rem; margin: 1.4rem 0;
  padding: 0;
}
.facts div { background: var(--panel); border-radius: .4rem; padding: .6rem .8rem; }
.facts dt { color: var(--soft); font-size: .82rem; }
.facts dd { margin: 0; font-size: 1.3rem; font-variant-numeric: tabular-nums; }
table { border-collapse: collapse; width: 100%; font-size: .9rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding-bottom: .5rem; }
th, td { padding: .35rem .55rem; border-bottom: 1px solid var(--line); text-align: left; }
td, tbody th { vertical-align: top; }
thead th { border-bottom: 2px solid var(--ink); font-weight: 600; vertical-align: bottom; }
tbody th { font-weight: 600; overflow-wrap: break-word; min-width: 6rem; max-width: 14rem; }
.number { text-align: right; } td.number { white-space: nowrap; }
.camera { min-width: 10rem; }
.wide { overflow-x: auto; }
.solved, .given { color: var(--good); } .ambiguous { color: var(--warn); } .failed { color: var(--bad); }
.problems li { margin: .5rem 0; }
.gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(24rem, 1fr)); gap: 1.2rem; }
figure { margin: 0; break-inside: avoid; }
figure img { display: block; width: 100%; height: auto; border-radius: .3rem; background: #8882; }
figcaption { font-size: .88rem; padding-top: .35rem; }
figcaption strong { color: var(--ink); }
.entry { white-space: nowrap; }
.swatch { display: inline-block; width: .8em; height: .8em; border-radius: .15em; margin: 0 .3em 0 .8em; }
.ramp { display: inline-block; width: 9em; height: .8em; border-radius: .15em; margin: 0 .4em; }
.key { display: inline-block; width: 1.6em; margin: 0 .35em 0 .9em; vertical-align: .25em; }
.key.drawn { border-top: 4px solid var(--drawn); } .key.projected { border-top: 2px solid var(--projected); }
@media (max-width: 30rem) { .gallery { grid-template-columns: 1fr; } body { padding: 1.2rem .8rem 3rem; } }
@page { size: A4; margin: 14mm; }
@media print {
  :root {
    --paper: #fff; --ink: #000; --soft: #444; --line: #bbb; --panel: #f3f3f3;
    --good: #1e6b3a; --warn: #8a5a00; --bad: #a1261c; --drawn: #b87a00; --projected: #1f5fd0;
  }
  body { max-width: none; padding: 0; font-size: 9.5pt; }
  h1 { font-size: 18pt; } h2 { font-size: 13pt; margin-top: 16pt; break-after: avoid; }
  .gallery { grid-template-columns: 1fr 1fr; gap: 4mm; } .facts { grid-template-columns: repeat(4, 1fr); }
  .facts dd { font-size: 12pt; } table { font-size: 7.5pt; } th, td { padding: 2pt 3pt; }
  .wide { overflow: visible; }
  .camera { min-width: 24mm; } section > p { break-after: avoid; }
  tr { break-inside: avoid; } * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""
