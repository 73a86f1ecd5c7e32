// What a page has, from top to bottom.

showRequest();
showTables();
showFigures();
showConfusion();
showFloors();
showQueries();
showWalks();
if (sets.length) look({arm: armsOf(sets[0])[0] ?? null});
