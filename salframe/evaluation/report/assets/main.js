// What a page has, from top to bottom.

showRequest();
showTables();
showFigures();
showConfusion();
showFloors();
showQueries();
showWalks();
if (sets.length) look({arm: armsOf(sets[0])[0] ?? null});
const linked = /^#q(\d+)-(\d+)$/.exec(location.hash); // the address of a query that was opened
if (linked && sets[linked[1]] && linked[2] < sets[linked[1]].ids.length) {
  look({set: Number(linked[1])});
  openQuery(Number(linked[2]));
}
