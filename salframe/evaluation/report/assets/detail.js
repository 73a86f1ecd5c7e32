// The details of one query: its panorama, the answer of each method, and the parts of the score.

const dialog = document.getElementById("detail");
const shown = {i: null, kind: "answer"}; // index of the query, and whether its answer or the truth is compared

function openQuery(i) {
  shown.i = i;
  history.replaceState(null, "", `#q${selection.set}-${i}`);
  shown.kind = "answer";
  paintDetail();
  if (!dialog.open) dialog.showModal();
  dialog.scrollTop = 0;
  dialog.focus();
}

// Open another query of the list: the next one (offset 1) or the previous one (offset -1).
function openNeighbour(offset) {
  const neighbour = filtered[filtered.indexOf(shown.i) + offset];
  if (neighbour !== undefined) openQuery(neighbour);
}

dialog.addEventListener("keydown", (event) => {
  if (event.target.matches("select, input")) return;
  if (event.key === "ArrowRight") openNeighbour(1);
  if (event.key === "ArrowLeft") openNeighbour(-1);
});
dialog.addEventListener("click", (event) => {
  if (event.target === dialog) dialog.close();
});
dialog.addEventListener("close", () => {
  history.replaceState(null, "", "#queries");
  const row = document.querySelector(`#queries tr[data-query="${shown.i}"]`);
  if (row) row.focus();
});
addEventListener("resize", () => {
  if (dialog.open) paintDetail();
});

function paintDetail() {
  const set = currentSet(),
    i = shown.i,
    arms = armsOf(set),
    position = filtered.indexOf(i);
  const text = island(`q${selection.set}-${i}`),
    query = text ? JSON.parse(text) : {objects: {}, arms: {}};
  const top = make(
    "div",
    {class: "top"},
    make("h2", {}, `${set.ids[i]}, true place: ${placeName(set.truth[i])}`),
    makeMenu(
      "method",
      arms.map((arm) => content.arms[arm].name),
      (k) => {
        updateSelection({arm: arms[k]});
        paintDetail();
      },
      arms.indexOf(selection.arm),
    ),
    make(
      "button",
      {type: "button", onclick: () => openNeighbour(-1), disabled: position < 1, "aria-label": "Previous query"},
      "←",
    ),
    make("span", {class: "note"}, position < 0 ? "" : `${position + 1} of ${filtered.length}`),
    make(
      "button",
      {
        type: "button",
        onclick: () => openNeighbour(1),
        disabled: position < 0 || position === filtered.length - 1,
        "aria-label": "Next query",
      },
      "→",
    ),
    make("button", {type: "button", onclick: () => dialog.close(), "aria-label": "Close"}, "✕"),
  );
  const details = query.arms[selection.arm];
  dialog.replaceChildren(
    top,
    make(
      "div",
      {class: "inside"},
      details
        ? showMatch(set, i, query, details)
        : text
          ? make("p", {class: "note"}, "The report has no details of the answer of this method.")
          : null,
      make("h3", {}, "Answers of all methods"),
      answersTable(set, i, arms),
    ),
  );
}

function showMatch(set, i, query, details) {
  const match = details.references.find((one) => one.kind === shown.kind) || details.references[0];
  const shownQuery = {url: island(`pq${selection.set}-${i}`), objects: query.objects[details.describer]};
  if (!match)
    return make(
      "div",
      {},
      drawPair(shownQuery, {url: null, objects: null}, {}, true),
      make("p", {class: "note"}, "The method did not answer a place."),
    );
  const frame = JSON.parse(island(`f${selection.set}-${match.frame}`));
  const reference = {
    url: island(`pf${selection.set}-${match.frame}`),
    objects: frame.objects[details.describer],
    pose: frame.pose,
  };
  const kinds =
    details.references.length < 2
      ? null
      : details.references.map((one) =>
          make(
            "button",
            {
              type: "button",
              "aria-pressed": String(one === match),
              onclick: () => {
                shown.kind = one.kind;
                paintDetail();
              },
            },
            one.kind === "answer" ? "answered place" : "true place",
          ),
        );
  const estimated = answersOf(selection.arm).pose[i],
    truth = set.poses[i],
    pose = estimated || truth;
  const matched = match.points
    ? `${match.matched} points matched${match.matched > match.points.length ? `, ${match.points.length} drawn` : ""}`
    : match.pairs
      ? `${match.pairs.length} of ${countObjects(shownQuery.objects)} objects matched`
      : "the method matches neither points nor objects";
  const floor = set.floors.find((one) => one.places.includes(frame.place)) || null;
  const shapes = shownQuery.objects && shownQuery.objects.box && reference.objects;
  return make(
    "div",
    {},
    make("div", {class: "tools"}, make("span", {}, `Matched with ${frame.id} in ${frame.place}: ${matched}`), kinds),
    drawPair(shownQuery, reference, match, innerWidth < 900),
    make(
      "div",
      {class: "columns"},
      pose || shapes
        ? make(
            "div",
            {class: "plan"},
            make(
              "h3",
              {},
              estimated
                ? "Top view with the estimated pose"
                : "Top view with the true pose of the query, because no pose was estimated",
            ),
            drawTopView(shownQuery, reference, match, pose, truth, floor),
            make(
              "p",
              {},
              [
                ["--c0", "query"],
                ["--c1", "map"],
                ["--c2", "true pose of the query"],
              ].map(([colour, name]) =>
                make(
                  "span",
                  {class: "key"},
                  make("span", {class: "swatch", style: `background: var(${colour}); margin: 0`}),
                  name,
                ),
              ),
            ),
          )
        : make("div", {}),
      make("div", {}, scoreTable(set, i, details)),
    ),
  );
}

// Create the table of the best-ranked places and, if the score of the method is a weighted sum, a table of its parts.
function scoreTable(set, i, details) {
  const evidence = details.evidence,
    fixed = (value, digits = 2) => (value === null || value === undefined ? "–" : value.toFixed(digits));
  const answers = answersOf(selection.arm);
  const ranked = make(
    "table",
    {},
    make(
      "thead",
      {},
      make("tr", {}, make("th", {class: "text"}, "place"), make("th", {}, "score"), make("th", {}, "probability")),
    ),
    make(
      "tbody",
      {},
      answers.ranked[i].map(([place, score, chance]) =>
        make(
          "tr",
          {},
          make("td", {class: "text"}, place),
          make("td", {}, fixed(score, 3)),
          make("td", {}, chance === null ? "–" : `${(100 * chance).toFixed(1)} %`),
        ),
      ),
      answers.out_of_map_probability[i] === null
        ? null
        : make(
            "tr",
            {},
            make("td", {class: "text"}, "out of map"),
            make("td", {}, ""),
            make("td", {}, `${(100 * answers.out_of_map_probability[i]).toFixed(1)} %`),
          ),
    ),
  );
  const rankedPart = [make("h3", {}, "Best-ranked places"), ranked];
  if (!evidence) return rankedPart;
  const total = (place) => place.values.reduce((sum, value, k) => sum + value * evidence.weights[k], 0);
  const table = make(
    "table",
    {},
    make(
      "thead",
      {},
      make(
        "tr",
        {},
        make("th", {class: "text"}, "part"),
        make("th", {}, "weight"),
        evidence.places.map((place) => [make("th", {}, place.place), make("th", {}, "× weight")]),
      ),
    ),
    make(
      "tbody",
      {},
      evidence.parts.map((part, k) =>
        make(
          "tr",
          {},
          make("td", {class: "text"}, part.replaceAll("_", " ")),
          make("td", {}, fixed(evidence.weights[k])),
          evidence.places.map((place) => [
            make("td", {}, fixed(place.values[k])),
            make("td", {class: "lead"}, fixed(place.values[k] * evidence.weights[k])),
          ]),
        ),
      ),
      make(
        "tr",
        {},
        make("td", {class: "text lead"}, "sum"),
        make("td", {}, ""),
        evidence.places.map((place) => [make("td", {}, ""), make("td", {class: "lead"}, fixed(total(place)))]),
      ),
    ),
  );
  return [
    make("h3", {}, "Parts of the score"),
    make("div", {class: "scroll"}, table),
    make(
      "p",
      {class: "note"},
      "The table shows the best hypothesis of each place. The score of a place combines all its hypotheses.",
    ),
    ...rankedPart,
  ];
}

function answersTable(set, i, arms) {
  const rows = arms.map((arm) => {
    const answers = answersOf(arm),
      outcome = answers.outcome[i],
      fixed = (value, digits) => (value === null ? "–" : value.toFixed(digits));
    const selectArm = () => {
      updateSelection({arm});
      paintDetail();
    };
    return make(
      "tr",
      {
        class: arm === selection.arm ? "row selected" : "row",
        tabindex: 0,
        onclick: selectArm,
        onkeydown: (event) => {
          if (event.key === "Enter") selectArm();
        },
      },
      make("td", {class: "text"}, content.arms[arm].name),
      make("td", {class: "text"}, placeName(answers.place[i])),
      make(
        "td",
        {class: "text"},
        make("span", {class: `outcome ${OUTCOME_CLASSES[outcome]}`}, content.outcomes[outcome]),
      ),
      make("td", {class: "text"}, [answers.status[i], answers.error[i]].filter(Boolean).join(": ")),
      make("td", {}, answers.ranked[i][0] ? fixed(answers.ranked[i][0][1], 3) : "–"),
      make(
        "td",
        {class: "text"},
        answers.ranked[i][1] ? `${answers.ranked[i][1][0]} ${fixed(answers.ranked[i][1][1], 3)}` : "–",
      ),
      make("td", {}, fixed(answers.translation_m[i], 2)),
      make("td", {}, fixed(answers.rotation_deg[i], 1)),
      make("td", {}, fixed(answers.ms[i], 0)),
    );
  });
  return make(
    "div",
    {class: "scroll"},
    make(
      "table",
      {},
      make(
        "thead",
        {},
        make(
          "tr",
          {},
          ["method", "answer", "outcome", "status"].map((name) => make("th", {class: "text"}, name)),
          make("th", {}, "score"),
          make("th", {class: "text"}, "runner-up"),
          ["error m", "error °", "ms"].map((name) => make("th", {}, name)),
        ),
      ),
      make("tbody", {}, rows),
    ),
  );
}
