"""Look of the pages: one accent colour, system fonts, light and dark, readable on paper."""

CSS = """
:root{--bg:#fbfbfa;--card:#fff;--ink:#1b1f24;--soft:#5b6470;--line:#e3e5e8;--grid:#eceef0;
--accent:#0f6fc6;--tint:#eaf3fb;--good:#1a7f4b;--goodbg:#e4f4eb;--fair:#8a6100;--fairbg:#fbf1d9;
--bad:#b3372b;--badbg:#fbe6e3;--mute:#6a7280;--mutebg:#eef0f2;--measured:#8b929c}
@media (prefers-color-scheme:dark){:root:not([data-theme=light]){--bg:#14171a;--card:#1c2024;
--ink:#e8eaed;--soft:#a2abb5;--line:#31373d;--grid:#2a2f35;--accent:#5aabf0;--tint:#1d2d3c;
--good:#5fcf95;--goodbg:#16331f;--fair:#e2b75c;--fairbg:#3a2f14;--bad:#f08a7e;--badbg:#412320;
--mute:#a2abb5;--mutebg:#2a2f35;--measured:#8b929c;color-scheme:dark}}
:root[data-theme=dark]{--bg:#14171a;--card:#1c2024;--ink:#e8eaed;--soft:#a2abb5;--line:#31373d;
--grid:#2a2f35;--accent:#5aabf0;--tint:#1d2d3c;--good:#5fcf95;--goodbg:#16331f;--fair:#e2b75c;
--fairbg:#3a2f14;--bad:#f08a7e;--badbg:#412320;--mute:#a2abb5;--mutebg:#2a2f35;--measured:#8b929c;
color-scheme:dark}
*{box-sizing:border-box}
html{scroll-behavior:smooth;scroll-padding-top:3.6rem;-webkit-text-size-adjust:100%}
body{margin:0;background:var(--bg);color:var(--ink);font:15px/1.55 system-ui,-apple-system,
"Segoe UI",Roboto,"Helvetica Neue",Arial,"Liberation Sans",sans-serif}
.bar{position:sticky;top:0;z-index:5;background:var(--bg);border-bottom:1px solid var(--line)}
.bar nav{max-width:1160px;margin:auto;padding:.55rem 1.25rem;display:flex;gap:.2rem 1.15rem;
align-items:center;flex-wrap:wrap}
.bar b{margin-right:auto;font-weight:650}
.bar a{color:var(--soft);text-decoration:none;font-size:.87rem}.bar a:hover{color:var(--accent)}
button{font:inherit;color:var(--soft);background:none;border:1px solid var(--line);cursor:pointer;
border-radius:6px;padding:.1rem .6rem;font-size:.83rem}
button:hover{border-color:var(--accent);color:var(--accent)}
main{max-width:1160px;margin:auto;padding:1.6rem 1.25rem 4rem}
header h1{font-size:1.75rem;line-height:1.2;margin:0;font-weight:680;letter-spacing:-.01em}
header p{color:var(--soft);margin:.3rem 0 0}
section{margin-top:2.5rem}
h2{font-size:1.18rem;margin:0 0 .3rem;font-weight:650}
h3{font-size:1rem;margin:1.5rem 0 .2rem;font-weight:620}
p{margin:.35rem 0 .7rem;max-width:46rem}
.lead{color:var(--soft)}
.verdict{font-size:1.12rem;line-height:1.5;max-width:52rem;margin:.2rem 0 .6rem}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:.8rem 1rem;
margin:.8rem 0}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(215px,1fr));gap:.8rem;
margin:1rem 0}
.tile{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:.8rem 1rem}
.tile .name{color:var(--soft);font-size:.87rem;display:flex;justify-content:space-between;gap:.5rem}
.tile .big{font-size:1.75rem;font-weight:660;letter-spacing:-.02em;line-height:1.25;
margin:.15rem 0 0}
.tile .note{color:var(--soft);font-size:.83rem;line-height:1.4}
.chip{white-space:nowrap;align-self:start}
.chip{display:inline-block;border-radius:999px;padding:.05rem .6rem;font-size:.8rem;line-height:1.5;
background:var(--mutebg);color:var(--mute)}
.chip.good{background:var(--goodbg);color:var(--good)}.chip.fair{background:var(--fairbg);
color:var(--fair)}.chip.bad{background:var(--badbg);color:var(--bad)}
.note-list{margin:.5rem 0;padding:0;list-style:none;max-width:60rem}
.note-list li{padding:.4rem .8rem;margin:.35rem 0;border-left:3px solid var(--fair);
background:var(--fairbg);border-radius:0 6px 6px 0;overflow-wrap:anywhere}
.plain-list{margin:.4rem 0 .8rem;padding-left:1.2rem}.plain-list li{margin:.25rem 0;
overflow-wrap:anywhere}
.scroll{overflow-x:auto;max-width:100%}
table{border-collapse:collapse;width:100%;font-size:.89rem}
th{text-align:left;font-weight:600;color:var(--soft);font-size:.83rem;padding:.45rem .7rem;
border-bottom:1px solid var(--line);white-space:nowrap}
td{padding:.32rem .7rem;border-bottom:1px solid var(--grid);vertical-align:top}
th.num,td.num{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
th[data-sort]{cursor:pointer;user-select:none}th[data-sort]:hover{color:var(--accent)}
th[aria-sort=ascending]::after{content:" \\2191"}th[aria-sort=descending]::after{content:" \\2193"}
tr.group td{background:var(--mutebg);font-weight:620;border-bottom:1px solid var(--line);
padding:.4rem .7rem}
tbody.folded tr:not(.group):not(.summary){display:none}
tr.summary td{color:var(--soft)}
td .sub{color:var(--soft);font-size:.82rem;line-height:1.4;max-width:34rem;overflow-wrap:anywhere}
code,.mono{font-family:ui-monospace,"SF Mono",Menlo,Consolas,"DejaVu Sans Mono",monospace;
font-size:.92em}
.open{color:var(--mute);font-style:italic}
.tabs>.heads{display:flex;gap:.3rem;flex-wrap:wrap;border-bottom:1px solid var(--line);
margin:.6rem 0 .8rem}
.tabs>.heads button{border:0;border-bottom:2px solid transparent;border-radius:0;
padding:.35rem .9rem;font-size:.95rem}
.tabs>.heads button[aria-selected=true]{color:var(--ink);border-bottom-color:var(--accent);
font-weight:620}
.tabs>.panel[hidden]{display:none}
.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(430px,1fr));gap:0 .8rem}
@media (max-width:520px){.pair{grid-template-columns:1fr}}
figure{margin:.8rem 0;background:var(--card);border:1px solid var(--line);border-radius:10px;
padding:.7rem .5rem .3rem;min-width:0}
figcaption{padding:0 .6rem .1rem;font-weight:600;font-size:.93rem}
figcaption span{display:block;font-weight:400;color:var(--soft);font-size:.85rem;line-height:1.4}
.plot{width:100%;position:relative}
.js-plotly-plot .modebar{opacity:0;transition:opacity .2s}
.js-plotly-plot:hover .modebar{opacity:1}
.tile h3{margin:0 0 .3rem}.tile .big.small{font-size:1.15rem}.tile .note+.name{margin-top:.55rem}
figure.machine{padding:0;max-width:760px;overflow:hidden}
.answer{display:grid;grid-template-columns:minmax(0,1.5fr) minmax(0,1fr);gap:.8rem;align-items:start;
margin:.8rem 0}.answer.many{grid-template-columns:1fr}
.answer>figure,.answer>.tiles{margin:0}.answer:not(.many) .tiles{grid-template-columns:1fr}
figure.machine svg{display:block;width:100%;height:auto}
figure.machine text{fill:var(--ink);font-size:15px;font-weight:600;paint-order:stroke;stroke:var(--card);
stroke-width:4px;stroke-linejoin:round}
figure.machine path{stroke:var(--ink);stroke-width:1.2}figure.machine circle{fill:var(--ink)}
.share{display:inline-block;position:relative;width:7rem;height:.7rem;background:var(--mutebg);
border-radius:3px;margin-right:.4rem;vertical-align:-.05rem;overflow:hidden}
.share i{position:absolute;left:0;top:0;bottom:0;background:#e8843b}
.share u{position:absolute;top:0;bottom:0;width:2px;background:var(--ink)}
details{margin:.6rem 0}summary{cursor:pointer;color:var(--soft);font-size:.89rem}
dl.facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(230px,1fr));gap:.4rem 1.2rem;margin:.6rem 0}
dl.facts dt{color:var(--soft);font-size:.8rem}dl.facts dd{margin:0;overflow-wrap:anywhere}
td>b{white-space:nowrap}
section a{color:var(--accent)}
footer{color:var(--soft);font-size:.83rem;margin-top:3rem;border-top:1px solid var(--line);
padding-top:.8rem}
noscript p{color:var(--bad)}
@media (max-width:620px){main{padding:1rem .8rem 3rem}.answer,.answer.many{grid-template-columns:1fr}
.tiles{grid-template-columns:1fr}
.bar nav{padding:.4rem .8rem;flex-wrap:nowrap;overflow-x:auto;white-space:nowrap}.bar a{font-size:.8rem}
figure.machine text{font-size:21px}
.card.scroll>table:not(.parameters){display:block}.card.scroll>table:not(.parameters)>thead{display:none}
.card.scroll>table:not(.parameters)>tbody{display:block}
.card.scroll>table:not(.parameters) tr{display:block;padding:.4rem 0;border-bottom:1px solid var(--line)}
.card.scroll>table:not(.parameters) td{display:flex;justify-content:space-between;gap:1rem;border:0;
padding:.12rem 0;text-align:right;white-space:normal}td>b{white-space:normal}
.card.scroll>table:not(.parameters) td::before{content:attr(data-head);color:var(--soft);text-align:left;
flex:0 0 38%}
.card.scroll>table:not(.parameters) td:empty{display:none}}
@page{size:A4;margin:12mm}
.paper main{width:1130px;max-width:none;padding:0}.paper td,.paper th{padding-top:.16rem;padding-bottom:.16rem}
.paper .tabs>.panel,.paper .tabs>.panel[hidden]{display:grid;grid-template-columns:1fr 1fr;gap:.8rem;
margin-bottom:.8rem}
.paper .tabs>.panel>*{grid-column:1/-1;margin:0}.paper .tabs>.panel>.pair{display:contents}
.paper .tabs>.panel>figure:not(:first-child),.paper .tabs>.panel>figure:nth-last-child(2):first-child{grid-column:auto}
.paper .panel .pair>figure{margin:0}
@media print{.bar{display:none}body{background:#fff;font-size:15px}main{max-width:none;zoom:.62;padding:0}
details:not(.big)>*{display:block}
details:not(.big)::details-content{content-visibility:visible;display:block}
figure.machine{max-width:560px}section{margin-top:1.6rem}h2,h3,.tabs .heads{break-after:avoid}
.card,tr,.tile{break-inside:avoid}.card.scroll{break-inside:auto}section{break-inside:auto}
figure,.tile{break-inside:avoid}.tabs>.heads{display:none}
button.fold{display:none}}
"""
