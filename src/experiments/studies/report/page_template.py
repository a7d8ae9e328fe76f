"""The report's page as a template: one file that needs nothing from elsewhere."""

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title>
<style>
:root { color-scheme: light; --line: #d5dae1; --soft: #f4f6f9; --text: #1b2430; --accent: #0b5cad; }
* { box-sizing: border-box; }
body { margin: 0; font: 15px/1.5 system-ui, sans-serif; color: var(--text); background: #fff; }
header, main, footer { max-width: 1280px; margin: 0 auto; padding: 0 20px; }
header { padding-top: 24px; }
h1 { font-size: 1.6rem; margin: 0 0 4px; }
h2 { font-size: 1.25rem; margin: 40px 0 6px; border-top: 1px solid var(--line); padding-top: 18px; }
h3 { font-size: 1rem; margin: 22px 0 6px; }
p, li { max-width: 78ch; }
a { color: var(--accent); }
a:focus-visible, button:focus-visible, summary:focus-visible { outline: 3px solid #f2a900; outline-offset: 2px; }
nav ul { display: flex; flex-wrap: wrap; gap: 4px 18px; list-style: none; padding: 0; margin: 14px 0 0; }
.wide { overflow-x: auto; margin: 6px 0 4px; border: 1px solid var(--line); border-radius: 6px; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td { padding: 5px 9px; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); }
th { background: var(--soft); white-space: nowrap; }
th button { font: inherit; font-weight: 600; border: 0; background: none; padding: 0; cursor: pointer; color: inherit; }
th button::after { content: " \\2195"; color: #8894a3; }
th.number { text-align: right; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tbody tr:last-child td { border-bottom: 0; }
code, .run { font: 12px/1.4 ui-monospace, monospace; }
.below { color: #4a5563; font-size: 12px; }
.note { color: #4a5563; font-size: 13px; margin: 2px 0 0; }
.badge { display: inline-block; border-radius: 10px; padding: 1px 9px; font-size: 12px; }
.yes { background: #d9f2e3; color: #0d5a2c; } .no { background: #fdeccf; color: #6d4300; }
.none { background: #e9edf2; }
figure { margin: 12px 0; } figure img { max-width: 100%; height: auto; border: 1px solid var(--line); }
iframe { width: 100%; height: 620px; border: 1px solid var(--line); border-radius: 6px; }
details { margin: 10px 0; } summary { cursor: pointer; }
footer { padding: 30px 20px; color: #4a5563; font-size: 13px; }
@media (max-width: 600px) { body { font-size: 14px; } iframe { height: 420px; } header, main { padding: 0 12px; } }
</style>
</head>
<body>
<header>
<h1>{{ title }}</h1>
<p class="note">{{ made }}</p>
<nav aria-label="Sections"><ul>
<li><a href="#published">Published values</a></li>
{% for section in sections %}<li><a href="#{{ section.anchor }}">{{ section.title }}</a></li>
{% endfor %}<li><a href="#provenance">Where the numbers come from</a></li>
</ul></nav>
</header>
<main>
<section id="published">
<h2>Published values</h2>
<p>{{ counted }}</p>
{{ table(published) }}
</section>
{% for section in sections %}
<section id="{{ section.anchor }}">
<h2>{{ section.title }}</h2>
<p class="note">{{ section.source }}</p>
{% if section.failure %}<p><span class="badge no">not summed up</span> {{ section.failure }}</p>{% endif %}
{% for one in section.tables %}<h3>{{ one.title }}</h3>
{{ table(one) }}
{% endfor %}
{% if section.findings %}<ul>{% for finding in section.findings %}<li>{{ finding }}</li>{% endfor %}</ul>{% endif %}
{% for figure in section.figures %}<figure><img src="{{ figure.data }}" alt="{{ figure.alt }}" loading="lazy">
<figcaption class="note">{{ figure.alt }}: <a href="{{ figure.stem }}.svg">SVG</a>,
<a href="{{ figure.stem }}.pdf">PDF</a>, <a href="{{ figure.stem }}.png">PNG</a></figcaption></figure>
{% endfor %}
{% for scene in section.scenes %}<h3>{{ scene.title }}</h3>
<iframe title="{{ scene.title }}" sandbox="allow-scripts" loading="lazy" srcdoc="{{ scene.html }}"></iframe>
{% endfor %}
</section>
{% endfor %}
<section id="provenance">
<h2>Where the numbers come from</h2>
<p>Every number of a section comes from the jobs of one run, whose id is given; <code>ctus study=reproduce run=ID</code>
runs it again and compares.</p>
{{ table(origin) }}
<details><summary>All {{ runs.rows | length }} jobs</summary>
{{ table(runs) }}
</details>
</section>
</main>
<footer>{{ made }}</footer>
<script>
document.querySelectorAll("th button").forEach(function (button) {
  button.addEventListener("click", function () {
    var cell = button.parentNode, body = cell.closest("table").tBodies[0];
    var place = Array.prototype.indexOf.call(cell.parentNode.children, cell);
    var down = cell.getAttribute("aria-sort") === "ascending";
    cell.parentNode.querySelectorAll("th").forEach(function (other) { other.removeAttribute("aria-sort"); });
    cell.setAttribute("aria-sort", down ? "descending" : "ascending");
    Array.from(body.rows).sort(function (a, b) {
      var x = a.cells[place].textContent, y = b.cells[place].textContent;
      var order = x.localeCompare(y, "en", { numeric: true });
      return down ? -order : order;
    }).forEach(function (row) { body.appendChild(row); });
  });
});
</script>
</body>
</html>
"""
TABLE = """<div class="wide" tabindex="0" role="region" aria-label="{{ one.title }}"><table><thead><tr>
{%- for name in one.columns -%}
<th scope="col"{% if one.rows and one.rows[0][loop.index0].number %} class="number"{% endif %}><button type="button">
{{- name }}</button></th>{% endfor -%}
</tr></thead><tbody>
{%- for row in one.rows %}<tr>{% for cell in row %}<td{% if cell.number %} class="number"{% endif %}>
{%- if cell.badge %}<span class="badge {{ cell.badge }}">{{ cell.text }}</span>
{%- elif cell.code %}<code>{{ cell.text }}</code>{% else %}{{ cell.text }}{% endif -%}
{% if cell.below %}<div class="below">{{ cell.below }}</div>{% endif -%}
</td>{% endfor %}</tr>{% endfor -%}
</tbody></table></div>
<p class="note">{% for kind in one.files %}<a href="{{ one.stem }}.{{ kind }}">{{ kind }}</a> {% endfor %}
{{ one.note }}</p>
"""
