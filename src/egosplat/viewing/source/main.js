// The page: reads the scene, draws it, answers.

const $ = (id) => document.getElementById(id);
// How long a picture may take while the view moves [ms]; longer ones are drawn with fewer pixels.
const FLUENT = 60;
// What a level is, in a word.
const LEVELS = { whole: "whole: a thing", part: "part: such as a drawer", subpart: "subpart: such as its handle" };
const GREY = 128, HIDDEN = 64, PAINTED = 255;

class Page {
  constructor(scene) {
    const { facts } = scene;
    this.scene = scene;
    this.tower = facts.tower && new TextTower(facts.tower, scene.arrays);
    this.canvas = $("view");
    const source = URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" }));
    this.renderer = new Renderer(this.canvas, scene, new Worker(source));
    this.neighbors = this.findNeighbors(source);
    this.camera = new SceneCamera(facts.up);
    this.share = 1;
    this.questions = 0;
    this.labels = new Map();
    this.there = []; // of each rest, whether it is at the time of the slider
    this.showing = { relevancy: null, level: scene.levels - 1, threshold: facts.query.min_score, only: false, instances: false, cameras: false };
    this.idle = Promise.resolve();
    this.fill();
    this.cameras = new Cameras($("cameras-view"), scene, this.urls, () => this.placeMarks());
    this.listen();
    this.showFrame(Math.max(0, facts.frames.indexOf(mostSeen(scene.views))));
    this.readAddress();
    window.addEventListener("hashchange", () => this.readAddress());
  }

  // Show the view and ask the words that the address holds behind its #.
  readAddress() {
    const told = new URLSearchParams(location.hash.slice(1)), asked = told.get("ask");
    const view = (told.get("view") ?? "").split(",").map(Number);
    if (view.length === 12 && view.every(Number.isFinite)) this.setView(view);
    if (asked) ($("words").value = asked), this.ask(asked);
  }

  // Put them there a while after the last change, so that the address can be sent: browsers refuse many changes a second.
  keepAddress() {
    clearTimeout(this.keeping);
    this.keeping = setTimeout(() => {
      const view = this.camera.pose().map((value) => Number(value.toFixed(4))).join(",");
      const told = new URLSearchParams({ ...(this.asked ? { ask: this.asked } : {}), view });
      try {
        history.replaceState(null, "", `#${told}`);
      } catch {
        // A page inside of another one has no address of its own.
      }
    }, 400);
  }

  findNeighbors(source) {
    const worker = new Worker(source), { count, means, radii } = this.scene, { nearest, reach } = this.scene.facts.query;
    return new Promise((resolve) => {
      worker.onmessage = ({ data }) => {
        worker.terminate();
        resolve(data.neighbors);
      };
      worker.postMessage({ means: means.slice(0, 3 * count), neighbors: { radii: radii.slice(0, count), nearest, reach } });
    });
  }

  // What is told about the scene. Every text that others wrote goes through textContent.
  fill() {
    const { facts } = this.scene;
    $("title").textContent = `${facts.title} (${facts.origin})`;
    for (const word of facts.words) $("vocabulary").append(element("option", "", { value: word }));
    $("catalog").append(...facts.catalog.map((thing) => this.catalogItem(thing)));
    $("inventory").querySelector("summary").textContent = `What is here (${facts.catalog.length})`;
    facts.levels.forEach((name, level) => $("level").append(element("option", LEVELS[name] ?? name, { value: String(level) })));
    $("level").value = String(this.showing.level);
    $("answer").title = facts.query.notice;
    $("frame").max = String(facts.frames.length - 1);
    $("instances").disabled = !this.scene.instance;
    $("threshold").value = String(this.showing.threshold);
    const all = facts.trained_count.toLocaleString("en"), number = facts.count.toLocaleString("en");
    const rows = {
      Origin: facts.origin,
      Recording: facts.recording,
      Gaussians: facts.count < facts.trained_count ? `${number} of ${all}: those that cover most` : number,
      Checkpoints: facts.checkpoints.join("; "),
      Words: this.tower ? "any; the text model is in this file" : document.documentElement.dataset.asking ? "any; egosplat view answers them" : `only the ${facts.words.length} of the list: the text model is too large for this file`,
      Pictures: document.documentElement.dataset.asking ? "click a thing to find what looks like it, or to name it" : "egosplat view finds what looks like a thing, and keeps names",
      Answers: facts.query.notice,
      Lengths: facts.unit,
      "Made by": `egosplat ${facts.version}`,
    };
    for (const [name, text] of Object.entries(rows)) $("facts").append(element("dt", name), element("dd", text));
    for (const line of facts.warnings) $("warnings").append(element("li", line));
    const count = facts.warnings.length;
    if (count) $("about").querySelector("summary").textContent = `About this scene (${count} ${count > 1 ? "warnings" : "warning"})`;
    this.urls = [];
    let place = 0;
    for (const { bytes } of facts.pictures) {
      this.urls.push(URL.createObjectURL(new Blob([this.scene.pictures.subarray(place, place + bytes)], { type: "image/webp" })));
      place += bytes;
    }
  }

  listen() {
    $("ask").onsubmit = (event) => {
      event.preventDefault();
      this.ask($("words").value);
    };
    // A choice from the list is asked at once; Chromium and Safari tell no type of it.
    $("words").oninput = ({ inputType = "insertReplacementText" }) => inputType === "insertReplacementText" && this.ask($("words").value);
    $("threshold").oninput = () => this.show({ threshold: Number($("threshold").value) });
    $("level").onchange = () => this.show({ level: Number($("level").value) });
    $("only").onchange = () => this.show({ only: $("only").checked });
    $("instances").onchange = () => this.show({ instances: $("instances").checked });
    $("cameras").onchange = () => this.showCameras($("cameras").checked);
    $("enlarge").onclick = () => {
      const hidden = $("photograph").toggleAttribute("hidden");
      $("enlarge").setAttribute("aria-pressed", String(!hidden));
    };
    this.canvas.addEventListener("pointermove", ({ clientX, clientY, buttons }) => {
      if (!buttons) this.canvas.classList.toggle("over-camera", this.cameraAt(clientX, clientY) !== null);
    });
    for (const button of $("judge").querySelectorAll("button")) button.onclick = () => this.judge(button.value);
    $("clear").onclick = () => ((this.asked = ""), this.clear());
    $("frame").oninput = () => (this.stop(), this.showFrame(Number($("frame").value), true));
    $("play").onclick = () => (this.playing ? this.stop() : this.play());
    $("fold").onclick = () => {
      const folded = $("inside").toggleAttribute("hidden");
      $("fold").textContent = folded ? "Show" : "Hide";
      $("fold").setAttribute("aria-expanded", String(!folded));
    };
    this.canvas.addEventListener("webglcontextlost", () => say("The graphics were lost: reload the page."));
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    this.controls = new Controls(this.canvas, {
      grasp: () => (this.stop(), (this.pivot ??= this.pointAhead())),
      turn: (right, down) => this.moved(() => this.camera.turn(-right, -down, this.orbits() ? this.pivot : null)),
      shift: (right, down) => this.moved(() => this.camera.move(-right * this.depth(), -down * this.depth(), 0), [right, down]),
      advance: (share) => this.moved(() => this.camera.move(0, 0, share * Math.max(this.depth(), 4 * this.scene.facts.near))),
      step: (right, up, forward) => {
        const step = 0.06 * Math.max(this.depth(), 4 * this.scene.facts.near);
        this.stop();
        this.pivot = null;
        this.moved(() => this.camera.move(right * step, -up * step, forward * step));
      },
      click: (x, y) => {
        const row = this.cameraAt(x, y);
        if (row === null) this.explain(x, y);
        else this.stop(), this.showFrame(row);
      },
      rest: () => {
        if (!this.orbits()) this.pivot = null;
        this.moving = false;
        this.redraw();
      },
    });
  }

  orbits() {
    return $("drag").value === "orbit";
  }

  // The point that the middle of the picture shows, which drags turn about.
  pointAhead() {
    const found = pick(this.scene, this.camera, this.focal(), this.size(), this.size()[0] / 2, this.size()[1] / 2);
    return found?.point ?? plus(this.camera.eye, this.camera.forward, this.lastDepth ?? 1);
  }

  depth() {
    if (this.pivot) this.lastDepth = Math.max(this.camera.toCamera(this.pivot)[2], 0);
    return this.lastDepth ?? 1;
  }

  moved(act, shift = null) {
    this.moving = true;
    act();
    if (shift && this.pivot) this.pivot = plus(plus(this.pivot, this.camera.right, -shift[0] * this.depth()), this.camera.down, -shift[1] * this.depth());
    this.redraw();
  }

  size() {
    return [this.canvas.clientWidth, this.canvas.clientHeight];
  }

  // Focal length [CSS pixels]: shows all that the recording's camera shows, but at most a right angle.
  focal() {
    if (this.fixedFocal) return this.fixedFocal;
    const [width, height] = this.size(), { camera } = this.scene.facts;
    return Math.max(Math.min((width * camera.fx) / camera.width, (height * camera.fy) / camera.height), 0.5 * Math.max(width, height));
  }

  redraw() {
    this.wanted = true;
    if (!this.drawing) this.idle = this.drawAll();
  }

  async drawAll() {
    this.drawing = true;
    while (this.wanted) {
      this.wanted = false;
      await this.renderer.sort(this.camera);
      await new Promise(requestAnimationFrame);
      this.draw(this.moving ? this.share : 1);
    }
    this.drawing = false;
    this.keepAddress();
  }

  draw(share) {
    const [width, height] = this.size(), ratio = Math.min(devicePixelRatio, this.share < 1 ? 1 : 2) * share;
    const sides = [width, height].map((side) => Math.max(1, Math.round(side * ratio)));
    if (this.canvas.width !== sides[0] || this.canvas.height !== sides[1]) [this.canvas.width, this.canvas.height] = sides;
    const begun = performance.now();
    this.renderer.draw(this.camera, (this.focal() * sides[0]) / width);
    this.renderer.finish();
    const taken = performance.now() - begun;
    if (taken > 1.3 * FLUENT) this.share = Math.max(0.2, share * Math.sqrt(FLUENT / taken));
    else if (taken < FLUENT / 2) this.share = Math.min(1, share * 1.25);
    this.placeMarks();
    if (!this.firstPicture) {
      this.firstPicture = performance.now();
      say("");
    }
  }

  // A pose of the camera (12 numbers) and a focal length [CSS pixels], for scripts.
  async setView(pose, focal = null) {
    this.fixedFocal = focal;
    this.camera.setPose(pose);
    this.pivot = null;
    this.redraw();
    await this.idle;
  }

  // Draw, and return the picture as a PNG address.
  async picture() {
    await this.renderer.sort(this.camera);
    this.draw(1);
    return this.canvas.toDataURL("image/png");
  }

  // The questions that a text asks, for scripts.
  read(text) {
    return readQuestions(this.scene.facts, cleanPhrase(text));
  }

  // The best answer to a phrase, with all.
  async ask(phrase) {
    const typed = cleanPhrase(phrase), { asking } = document.documentElement.dataset;
    this.asked = typed;
    if (!typed) return this.answer(typed, [refused("", "Type the name of a thing.")]);
    if (asking && typed.length <= LONGEST) return this.answer(typed, askServer(this.scene, asking, { phrase: typed }));
    return this.answer(typed, answerAlone(this.scene, this.tower, this.neighbors, typed));
  }

  // Ask what looks like the thing that was clicked, or give it a name; egosplat view has its pictures.
  askLike(like, name = null) {
    if (name) $("vocabulary").append(element("option", "", { value: name }));
    return this.answer(name ?? ALIKE, askServer(this.scene, document.documentElement.dataset.asking, name ? { like, name } : { like }));
  }

  // Tell answers once they are there. Until then nothing of the last question is shown.
  async answer(typed, coming) {
    const begun = performance.now();
    this.clear();
    const question = this.questions;
    $("answer").textContent = `"${shortened(typed)}" `;
    $("answer").setAttribute("aria-busy", "true");
    const answers = await coming;
    if (question !== this.questions) return null;
    const told = this.tell(typed, answers), { vector, things: [best] } = told;
    this.mark = best?.center ? { point: best.center, text: this.markOf(told.name, best, told) } : null;
    const relevancy = told.relevancy ?? (vector ? gaussianRelevancy(this.scene, vector, told.phrase) : ofInstances(this.scene, told.things));
    this.answerTime = performance.now() - begun;
    this.heatTime = told.relevancy ? this.scene.heated - begun : this.answerTime;
    $("heat").hidden = !relevancy;
    this.tellHistory(told.name, told.history, told.moving?.spans.map(([from, until]) => ({ from, until })));
    this.show({ relevancy, level: told.level ?? this.showing.level, instances: false });
    return told;
  }

  // Keep what a user says of the answer that is shown, for egosplat calibrate.
  judge(label) {
    this.labels.set(this.judged, label);
    const lines = [...this.labels].map(([phrase, kind]) => `"${phrase.replaceAll('"', '""')}",${kind}\n`);
    $("labels").href = `data:text/csv;charset=utf-8,${encodeURIComponent(["phrase,label\n", ...lines].join(""))}`;
    $("labels").textContent = `labels.csv, ${lines.length}`;
    $("labels").hidden = false;
  }

  score(score) {
    const { min_score } = this.scene.facts.query;
    return shownFigure(score, (one) => one >= min_score);
  }

  rating(rating) {
    return shownFigure(rating, (one) => gradeOf(this.scene, one));
  }

  // A graded number behind what it is.
  rated(answer, rating) {
    if (answer.measure) return `${answer.measure} ${rating.toFixed(2)}`;
    return `${this.scene.facts.query.measure} ${this.rating(rating)}`;
  }

  markOf(phrase, thing, answer) {
    return `${shortened(phrase)}${answer.grade === "best guess" ? ", best guess" : ""}, ${this.rated(answer, thing.rating)}`;
  }

  // Tell all answers; the first that has things is what is colored.
  tell(typed, answers) {
    const best = answers.find(({ things }) => things.length) ?? answers[0], [{ name }] = answers;
    const asTyped = [name, `"${name}"`].some((one) => one.toLowerCase() === typed.toLowerCase());
    const verdicts = answers.map((answer) => this.verdict(answer));
    const read = answers.length > 1 || asTyped || !name ? "" : ` (read as: ${shortened(name)})`;
    this.told = answers.length > 1 ? [`"${shortened(typed)}":`, ...answers.map(({ name }, row) => `${shortened(name)}: ${verdicts[row]}`)].join("\n") : `"${shortened(typed)}"${read}: ${verdicts[0]}`;
    this.sought = best.things[0]?.center ?? null;
    this.judged = best.name;
    $("judge").hidden = !best.name || Boolean(best.measure) || best.rating == null || Boolean(this.read(best.name)[0].relation);
    this.sayAnswer();
    const items = answers.flatMap((answer) => (answer.moving ? [this.frameItem(answer.moving.frame)] : answer.things.map((thing) => this.thingItem(thing, answer, answers.length > 1))));
    const meant = [...new Set(answers.flatMap(({ why }) => /Did you mean "(.+)"\?/.exec(why ?? "")?.[1] ?? []))];
    $("things").replaceChildren(...items, ...meant.map((phrase) => this.buttonItem(`\u2192 Ask for ${phrase}`, () => (($("words").value = phrase), this.ask(phrase)))));
    return { phrase: typed, ...best, read: read ? name : null, answers };
  }

  // Why nothing is found, or how sure it is.
  verdict(answer) {
    const { name, things, grade, why, moving, history } = answer, rating = moving ? moving.rating : answer.rating;
    // What moves is masked: a carried thing is found nowhere, and yet known.
    if (why && history.length && !moving && !this.read(name)[0].relation) return "it was carried, so it has no single place";
    if (why) return rating && !answer.measure ? `${why} (${this.rated(answer, rating)})` : why;
    return things.length > 1 ? `${grade}, ${things.length} of them` : grade;
  }

  // The answer, and whether what it is about is in view, which changes as the viewer moves.
  sayAnswer() {
    $("answer").removeAttribute("aria-busy");
    const outside = this.sought && !this.project(this.sought) ? ", outside of the view" : "";
    if ($("answer").textContent !== this.told + outside) $("answer").textContent = this.told + outside;
  }

  // The carries of the answer, in a list and on the time line, where without any the times are in which it moves; the ring goes to
  // where the thing was.
  tellHistory(phrase, history, moving = []) {
    this.history = history.length ? { phrase, history } : null;
    const share = (second) => (100 * this.rowAt(second)) / Math.max(this.scene.facts.frames.length - 1, 1);
    $("carried").replaceChildren(...(history.length ? history : moving).map(({ from, until }) => {
      const bar = element("i", "");
      bar.style.left = `${share(from)}%`;
      bar.style.width = `calc(${share(until) - share(from)}% + 3px)`;
      return bar;
    }));
    $("history").replaceChildren(...history.map((carry) => {
      const item = element("li", ""), button = element("button", `\u2192 Carried from ${minutes(carry.from)} to ${minutes(carry.until)}`, { type: "button" });
      button.append(element("small", [carry.start && `from ${place(carry.start)}`, carry.end && `to ${place(carry.end)}`, (carry.start || carry.end) && this.scene.facts.unit].filter(Boolean).join(" ")));
      button.onclick = () => (this.stop(), this.showFrame(this.rowAt(carry.until)));
      item.append(button);
      return item;
    }));
    this.followHistory();
  }

  // The row of the first frame from a time on, whose own is rounded to hundredths; else the last row.
  rowAt(second) {
    const { seconds } = this.scene.facts, row = seconds.findIndex((one) => one > second - 0.006);
    return row < 0 ? seconds.length - 1 : row;
  }

  followHistory() {
    if (!this.history) return;
    const { phrase, history } = this.history, { point, told } = placeAt(history, this.scene.facts.seconds[Number($("frame").value)], this.scene.facts.query.apart);
    this.mark = point && { point, text: `${shortened(phrase)} ${told}` };
    this.sought = point;
    this.placeMarks();
  }

  // Show what rests at a time.
  followRests(second) {
    const there = this.scene.facts.rests.map(({ from, until }) => from <= second && second <= until);
    if (there.every((one, number) => one === this.there[number])) return;
    this.there = there;
    this.renderer.setPaint(this.painted());
    this.redraw();
  }

  buttonItem(text, act) {
    const item = element("li", ""), button = element("button", text, { type: "button" });
    button.onclick = act;
    item.append(button);
    return item;
  }

  thingItem(thing, answer, named) {
    const { facts } = this.scene;
    if (!thing.center) return this.frameItem(thing.frame);
    const item = this.buttonItem(`\u2192 Go there: ${answer.grade}, ${this.rated(answer, thing.rating)}, ${facts.levels[thing.level]}, frame ${thing.frame}`, () => this.jump(thing, answer));
    const size = thing.size.map((side) => side.toFixed(2)).join(" x ");
    if (named) item.firstChild.prepend(element("b", answer.name));
    item.firstChild.append(element("small", `at ${place(thing.center)} ${facts.unit}, size ${size} ${facts.unit}`));
    return item;
  }

  // A thing of the list of all: a click goes there, or tells when it moved.
  catalogItem(answer) {
    const { name, also, things: [thing], grade, why } = answer;
    const item = thing ? this.thingItem(thing, answer, true) : this.buttonItem(why ?? grade, () => this.ask(name)), button = item.firstChild;
    if (!thing) button.prepend(element("b", name));
    if (also.length) button.querySelector("b").after(element("small", `or ${also.join(", ")}`));
    if (thing) button.onclick = () => (this.clear(), (this.told = name), this.jump(thing, answer));
    return item;
  }

  // To the frame that shows most of what moves.
  frameItem(frame) {
    return this.buttonItem(`\u2192 Go to frame ${frame}`, () => (this.stop(), this.showFrame(Math.max(0, this.scene.facts.frames.findIndex((one) => one >= frame)))));
  }

  // To the frame that shows a thing best, but not farther away than it needs.
  jump(thing, answer) {
    const { facts, poses } = this.scene, row = 12 * facts.frames.indexOf(thing.frame);
    const eye = [3, 7, 11].map((entry) => poses[row + entry]);
    const away = plus(eye, thing.center, -1), distance = Math.hypot(...away);
    const enough = Math.max(2 * Math.hypot(...thing.size), 6 * facts.near);
    const nearer = enough < distance ? plus(thing.center, unit(away), enough) : eye;
    this.stop();
    this.showPhotograph(row / 12);
    this.camera.lookAt(nearer, thing.center);
    this.pivot = this.sought = thing.center;
    this.moving = false;
    this.mark = { point: thing.center, text: this.markOf(answer.name, thing, answer) };
    this.show({ level: thing.level });
  }

  clear() {
    this.questions++;
    this.mark = this.sought = null;
    this.tellHistory("", []);
    $("heat").hidden = $("judge").hidden = true;
    $("answer").textContent = "";
    $("answer").removeAttribute("aria-busy");
    $("things").replaceChildren();
    this.show({ relevancy: null });
  }

  show(changes) {
    Object.assign(this.showing, changes);
    $("level").value = String(this.showing.level);
    $("instances").checked = this.showing.instances;
    $("threshold-value").textContent = this.showing.threshold.toFixed(2);
    this.renderer.setPaint(this.painted());
    this.redraw();
  }

  painted() {
    const { relevancy, level, threshold, only, instances } = this.showing, { count, drawn, instance } = this.scene;
    const paint = new Uint8Array(4 * drawn), background = only && !instances ? HIDDEN : GREY, plain = !relevancy && !instances;
    let next = count;
    this.there.forEach((isThere, number) => {
      for (const end = next + this.scene.facts.rests[number].count; next < end; next++)
        paint[4 * next + 3] = !isThere ? HIDDEN : plain ? 0 : background;
    });
    if (plain) return paint;
    for (let one = 0; one < count; one++) {
      const value = relevancy?.[level][one], number = instance?.[level][one];
      if (instances && number) paint.set([...instanceColor(number), PAINTED], 4 * one);
      else if (!instances && value >= threshold && value > 0) paint.set([...turbo(value), PAINTED], 4 * one);
      else paint[4 * one + 3] = background;
    }
    return paint;
  }

  // Say what a point of the window shows.
  explain(x, y) {
    const found = pick(this.scene, this.camera, this.focal(), this.size(), x, y);
    if (!found) {
      $("place").textContent = "Nothing is there.";
      return null;
    }
    const { words, instances, point } = describe(this.scene, found), { facts } = this.scene;
    const named = ({ word, score, level }) => `${word} (${facts.levels[level]}, relevancy ${this.score(score)})`;
    // Scores of models that nobody has calibrated tell what is closest, not what fits.
    const { calibration, found: sure, guess, min_score } = facts.query, least = calibration || sure === guess ? min_score : Infinity;
    const fitting = words.filter((word) => word.score >= least).slice(0, 3);
    const closest = words.length ? `${least < Infinity ? "No word of the list fits. " : ""}The closest word is ${named(words[0])}.` : "No word of the list fits.";
    $("place").textContent = fitting.length ? fitting.map(named).join(", ") : closest;
    const at = instances?.map((number, level) => (number === null ? null : `${facts.levels[level]} ${number}`)).filter(Boolean);
    const instance = at?.length ? `; instances ${at.join(", ")}` : "";
    $("place").append(element("small", `at ${place(point)} ${facts.unit}${instance}`));
    this.mark = { point, text: fitting.length ? fitting[0].word : "?" };
    this.placeMarks();
    const own = instances?.[this.showing.level] ?? instances?.findLast((one) => one !== null) ?? null;
    if (document.documentElement.dataset.asking && own !== null) this.offerInstance(own);
    return { words, instances, point };
  }

  // Buttons for the thing that was clicked.
  offerInstance(number) {
    const row = element("form", "", { class: "row" }), name = element("input", "", { type: "text", placeholder: "a name: my mug", "aria-label": "A name for this thing" });
    const like = element("button", "More like this", { type: "button" });
    like.onclick = () => this.askLike(number);
    row.onsubmit = (event) => (event.preventDefault(), name.value.trim() && this.askLike(number, cleanPhrase(name.value)));
    row.append(like, name, element("button", "Name it", { type: "submit" }));
    $("place").append(row);
  }

  showCameras(cameras) {
    this.showing.cameras = cameras;
    $("cameras-view").hidden = !cameras;
    this.placeMarks();
    if (!cameras || this.cameras.drawn.length) return;
    // From among the cameras none is in view: step back.
    this.camera.move(0, 0, -this.cameras.reach);
    this.pivot = null;
    this.redraw();
  }

  // The row of the camera that is drawn at a point of the window; null for none.
  cameraAt(x, y) {
    return this.showing.cameras ? this.cameras.at(x, y) : null;
  }

  // What lies over the picture: the ring at an answer, and the cameras.
  placeMarks() {
    if (this.showing.cameras) this.cameras.draw((point) => this.onScreen(point), this.camera.eye, this.size(), Number($("frame").value));
    if (this.sought) this.sayAnswer();
    const mark = $("mark"), at = this.mark && this.project(this.mark.point);
    mark.hidden = !at;
    if (!at) return;
    mark.querySelector("span").textContent = this.mark.text;
    mark.style.transform = `translate(${at[0]}px, ${at[1]}px)`;
  }

  // Window coordinates of a point; null behind the viewer.
  onScreen(point) {
    const [x, y, z] = this.camera.toCamera(point), [width, height] = this.size();
    return z < this.scene.facts.near ? null : [width / 2 + (this.focal() * x) / z, height / 2 + (this.focal() * y) / z];
  }

  // Window coordinates of a point; null outside of the picture.
  project(point) {
    const at = this.onScreen(point), [width, height] = this.size();
    return at && at[0] >= 0 && at[0] <= width && at[1] >= 0 && at[1] <= height ? at : null;
  }

  // Stand where the wearer stood.
  showFrame(row, moving = false) {
    this.camera.setPose(this.scene.poses.subarray(12 * row, 12 * row + 12));
    this.pivot = null;
    this.moving = moving;
    this.showPhotograph(row);
    this.redraw();
    clearTimeout(this.resting);
    if (moving) this.resting = setTimeout(() => ((this.moving = this.playing ?? false), this.redraw()), 250);
  }

  // The slider, the clock and the picture of a frame; the view stays.
  showPhotograph(row) {
    const { facts } = this.scene, frame = facts.frames[row];
    $("frame").value = String(row);
    $("clock").textContent = `${facts.seconds[row].toFixed(1)} s, frame ${frame}`;
    $("frame").setAttribute("aria-valuetext", $("clock").textContent);
    this.followHistory();
    this.followRests(facts.seconds[row]);
    const nearest = facts.pictures.reduce((best, one, place) => (Math.abs(one.frame - frame) < Math.abs(facts.pictures[best].frame - frame) ? place : best), 0);
    $("picture").src = this.urls[nearest];
    $("photograph").querySelector("img").src = this.urls[nearest];
    const told = `Photograph of frame ${facts.pictures[nearest].frame}`;
    $("picture").alt = $("photograph").querySelector("img").alt = told;
    $("photograph").querySelector("figcaption").textContent = told;
  }

  async play() {
    const { seconds } = this.scene.facts, last = seconds.length - 1;
    const row = Number($("frame").value), from = row < last ? row : 0, begun = performance.now();
    const mine = (this.playing = {});
    this.offer("\u275a\u275a", "Pause");
    while (this.playing === mine) {
      const now = seconds[from] + (performance.now() - begun) / 1000;
      const next = seconds.findIndex((time) => time > now);
      this.showFrame(next < 0 ? last : Math.max(next - 1, from), true);
      if (next < 0) break;
      await Promise.all([this.idle, new Promise((resolve) => setTimeout(resolve, 30))]);
    }
    if (this.playing === mine) this.stop();
  }

  stop() {
    this.playing = null;
    this.offer("\u25b6", "Play the recording");
  }

  // What the button beside the slider does next.
  offer(sign, told) {
    $("play").textContent = sign;
    $("play").setAttribute("aria-label", told);
  }
}

function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

const shortened = (text) => (text.length > 60 ? `${text.slice(0, 60)}...` : text);
const place = (point) => point.map((value) => value.toFixed(2)).join(", ");

function say(text) {
  $("state").textContent = text;
}

// Google's color map Turbo, by its published polynomial (Mikhailov 2019); bytes.
function turbo(value) {
  const powers = [1, value, value ** 2, value ** 3, value ** 4, value ** 5];
  return [
    [0.13572138, 4.6153926, -42.66032258, 132.13108234, -152.94239396, 59.28637943],
    [0.09140261, 2.19418839, 4.84296658, -14.18503333, 4.27729857, 2.82956604],
    [0.1066733, 12.64194608, -60.58204836, 110.36276771, -89.90310912, 27.34824973],
  ].map((factors) => Math.max(0, Math.min(255, 255 * factors.reduce((sum, factor, power) => sum + factor * powers[power], 0))));
}

// Neighboring numbers get hues far apart.
function instanceColor(number) {
  const hue = (number * 0.618034) % 1;
  return [0, 1 / 3, 2 / 3].map((shift) => 150 + 105 * Math.cos(2 * Math.PI * (hue - shift)));
}

async function start() {
  try {
    if (!("DecompressionStream" in window)) throw new Error("This browser is too old for the page: it cannot unpack gzip.");
    const raw = await unpackScene($("data").textContent.trim());
    $("data").remove();
    window.egosplat = new Page(buildScene(raw));
  } catch (error) {
    say(`The scene cannot be shown. ${error.message}`);
    console.error(error);
  }
}

start();
