// Draw the sections of the page, from top to bottom.

showRequest();
showTables();
showFigures();
showConfusion();
showFloors();
showQueries();
showWalks();
if (sets.length) updateSelection({arm: armsOf(sets[0])[0] ?? null});
const linked = /^#q(\d+)-(\d+)$/.exec(location.hash); // the address contains the data set and the query to open
if (linked && sets[linked[1]] && linked[2] < sets[linked[1]].ids.length) {
  updateSelection({set: Number(linked[1])});
  openQuery(Number(linked[2]));
}
