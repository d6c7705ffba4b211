// The replay: a record of a target vehicle (TV) and its own vehicle (UV) as a road that moves, seen from above.
// It reads the JSON in #replay-data, which `evaluation/report/replay/content.py` describes. Metres and seconds throughout.
"use strict";
(() => {
  const element = (id) => document.getElementById(id);
  const road = element("replay"), answers = element("replay-answers"), inside = element("replay-inside"), slider = element("replay-time");
  const picker = element("replay-record"), playButton = element("replay-play"), status = element("replay-status");
  let data;
  try {
    data = JSON.parse(element("replay-data").textContent);
    if (!data.records.length) throw new Error("no records");
  } catch {
    status.textContent = "The replay's data are missing from this page, or damaged: make the page again.";
    return;
  }
  const MARKS = ["circle", "square", "triangle", "diamond", "cross", "star"];
  const ALARM_STAYS = 2; // How long the road shows an alarm, s.
  const WITHIN = 2.448; // Standard deviations that hold 95 % of a normal distribution in the plane.
  const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [14, 5], [5, 2]];
  const words = (name) => name.replaceAll("_", " ");
  const lanes = data.lanes.map((lane) => {
    const points = [];
    for (let k = 0; k < lane.line.length; k += 2) points.push([lane.line[k], lane.line[k + 1]]);
    return { width: lane.width, points };
  });
  // Panels of one mast share a label.
  const masts = [];
  for (const [name, x, y] of data.sites) {
    const mast = masts.find((one) => Math.hypot(one[1] - x, one[2] - y) < 3);
    if (mast) mast[0] += `, ${name}`;
    else masts.push([name, x, y]);
  }
  const kept = new Map(); // Unpacked records, by their number.
  let number = 0, record = null, time = 0, playing = false, last = 0, zoom = 1, colours = {}, letters = 1, frames = 0;

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

  // Places as [x, y, x, y, ...]: 16-bit numbers of `step` metres around `middle`.
  function unpack(text, middle, step) {
    const raw = bytes(text), view = new DataView(raw.buffer), places = new Float64Array(raw.length / 2);
    for (let k = 0; k < places.length; k++) places[k] = middle[k % middle.length] + step * view.getInt16(2 * k, true);
    return places;
  }

  function unpacked(which) {
    if (!kept.has(which)) {
      const from = data.records[which], places = (text) => unpack(text, from.middle, from.step);
      const one = { ...from, truth: places(from.truth), sensed: places(from.sensed), uv: places(from.uv) };
      one.others = from.others.map((other) => ({ ...other, places: places(other.places) }));
      if (from.scene) {
        const { tracks, detected } = from.scene;
        one.tracks = tracks.map((track) => ({
          ...track,
          places: places(track.places),
          spread: unpack(track.spread, [0, 0, 0], track.finest),
        }));
        one.detected = { ...detected, places: places(detected.places) };
      }
      if (from.answers) {
        const modules = from.answers.inside.map((module) => ({ ...module, lines: module.lines.map(bytes) }));
        one.answers = { ...from.answers, probabilities: bytes(from.answers.probabilities), inside: modules };
      }
      one.duration = (one.truth.length / 2 - 1) / one.rate;
      one.heading = direction(one.truth, 0, one.truth.length / 2 - 1) ?? 0;
      kept.set(which, one);
    }
    return kept.get(which);
  }

  // Where a path is at a row that may lie between two; null outside.
  function at(places, row) {
    const rows = places.length / 2;
    if (row < -1e-6 || row > rows - 1 + 1e-6) return null;
    const first = Math.min(Math.max(Math.floor(row), 0), Math.max(rows - 2, 0)), share = row - first;
    const next = Math.min(first + 1, rows - 1);
    return [0, 1].map((k) => places[2 * first + k] * (1 - share) + places[2 * next + k] * share);
  }

  // The direction from one row of a path to another, rad; null where it does not move.
  function direction(places, from, to) {
    const a = at(places, Math.max(from, 0)), b = at(places, Math.min(to, places.length / 2 - 1));
    return Math.hypot(b[0] - a[0], b[1] - a[1]) < 0.1 ? null : Math.atan2(b[1] - a[1], b[0] - a[0]);
  }

  // Where a vehicle faces: as it moves around this row, or at all, or else along the nearest lane.
  function facing(places, row, reach) {
    const rows = places.length / 2 - 1;
    return direction(places, row - reach, row + reach) ?? direction(places, 0, rows) ?? alongLane(at(places, row));
  }

  function alongLane(place) {
    let best = Infinity, angle = 0;
    for (const { points } of lanes) {
      for (let k = 1; k < points.length; k++) {
        const [a, b] = [points[k - 1], points[k]], dx = b[0] - a[0], dy = b[1] - a[1];
        const along = ((place[0] - a[0]) * dx + (place[1] - a[1]) * dy) / (dx * dx + dy * dy || 1);
        const share = Math.min(Math.max(along, 0), 1);
        const gap = Math.hypot(place[0] - a[0] - share * dx, place[1] - a[1] - share * dy);
        if (gap < best) [best, angle] = [gap, Math.atan2(dy, dx)];
      }
    }
    return angle;
  }

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    const names = ["ground", "road", "marking", "ink", "soft", "line", "tv", "sensed", "uv", "other", "site"];
    colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim() || "#888"]));
    letters = Math.min((Number.parseFloat(style.fontSize) || 16) / 16, 1.5); // Letters grow with the page's.
    colours.classes = MARKS.map((_, k) => style.getPropertyValue(`--class-${k}`).trim() || "#888");
  }

  // Gives a canvas as many pixels as its place on the screen has, and returns its context, in CSS pixels.
  function sized(canvas, height) {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth || 1100;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      canvas.style.height = `${height}px`;
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    return [pen, width, height];
  }

  function drawRoad() {
    const [pen, width, height] = sized(road, road.clientWidth < 600 ? 240 : 360);
    const row = time * record.rate, tv = at(record.truth, row), scale = (zoom * width) / (width < 600 ? 80 : 160);
    const cos = Math.cos(record.heading), sin = Math.sin(record.heading);
    const put = (x, y) => {
      const dx = x - tv[0], dy = y - tv[1];
      return [width / 2 + scale * (cos * dx + sin * dy), height / 2 - scale * (cos * dy - sin * dx)];
    };
    pen.fillStyle = colours.ground;
    pen.fillRect(0, 0, width, height);
    pen.lineJoin = "round";
    const along = (points, style, thick, dash = []) => {
      pen.beginPath();
      points.forEach(([x, y], k) => pen[k ? "lineTo" : "moveTo"](...put(x, y)));
      pen.strokeStyle = style;
      pen.lineWidth = thick;
      pen.setLineDash(dash);
      pen.stroke();
      pen.setLineDash([]);
    };
    for (const lane of lanes) along(lane.points, colours.marking, (lane.width + 0.25) * scale);
    for (const lane of lanes) along(lane.points, colours.road, (lane.width - 0.15) * scale);
    const path = (places, until, style, thick, dash) => {
      const points = [];
      for (let k = 0; k <= until + 1e-9 && 2 * k < places.length; k++) points.push([places[2 * k], places[2 * k + 1]]);
      const end = at(places, until);
      if (end) points.push(end);
      if (points.length > 1) along(points, style, thick, dash);
    };
    for (const other of record.others) {
      const where = (time - other.from) / other.step, place = at(other.places, where);
      if (place) vehicle(pen, put, scale, place, facing(other.places, where, 1), other.size, colours.other, "");
    }
    const uvRow = row - record.from.uv * record.rate, uv = at(record.uv, uvRow);
    path(record.uv, uvRow, colours.uv, 2, [6, 4]);
    path(record.sensed, row - record.from.sensed * record.rate, colours.sensed, 5);
    path(record.truth, row, colours.ink, 1.5);
    if (uv) vehicle(pen, put, scale, uv, facing(record.uv, uvRow, 5), record.sizes[1], colours.uv, "UV");
    vehicle(pen, put, scale, tv, facing(record.truth, row, 5), record.sizes[0], colours.tv, "TV");
    if (record.scene) drawScene(pen, put, scale);
    for (const one of record.told ?? []) drawTold(pen, put, scale, one);
    for (const [, x, y, azimuth] of data.sites) panel(pen, put(x, y), ((90 - azimuth) * Math.PI) / 180);
    for (const [names, x, y] of masts) {
      const [left, top] = put(x, y);
      if (left < 0 || left > width) continue;
      pen.font = `${12 * letters}px system-ui, sans-serif`;
      const half = Math.min(pen.measureText(names).width, width) / 2; // The label stays on the canvas.
      label(pen, names, Math.min(Math.max(left, half + 4), width - half - 4), top - 12, "center");
    }
    drawMap(pen, width, tv);
    const bar = 20 * scale;
    pen.fillStyle = colours.ink;
    pen.fillRect(12, height - 14, bar, 3);
    label(pen, "20 m", 12, height - 20, "left");
    const said = [doing()], alarm = record.alarms.findLast(([, t]) => t <= time && time < t + ALARM_STAYS);
    if (alarm) said.push(`${alarm[2] === null ? "alarm" : alarm[2] ? "✗ false alarm" : "✓ alarm"}: ${words(alarm[0])}`);
    for (const one of record.told ?? []) {
      const stage = stageOf(one);
      if (stage) said.push(`${one.vehicle}: ${one.says} (${stage}), on the alarm for ${one.alarm}`);
    }
    said.forEach((text, k) => {
      const top = (20 + 20 * k) * letters;
      pen.font = `600 ${14 * letters}px system-ui, sans-serif`;
      pen.fillStyle = colours.ground; // Nothing of the road shows through.
      pen.fillRect(8, top - 15 * letters, pen.measureText(text).width + 8, 20 * letters);
      label(pen, text, 12, top, "left", true);
    });
  }

  // The tracks of a scene, each with its number and 95 % of its position, and the detections of the latest instant.
  function drawScene(pen, put, scale) {
    const { from, step, counts, places } = record.detected, latest = Math.floor((time - from) / step + 1e-6);
    const before = counts.slice(0, Math.max(latest, 0)).reduce((sum, count) => sum + count, 0);
    pen.strokeStyle = colours.site;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let k = before; latest >= 0 && k < before + (counts[latest] ?? 0); k++) {
      const [x, y] = put(places[2 * k], places[2 * k + 1]);
      pen.moveTo(x - 3, y);
      pen.lineTo(x + 3, y);
      pen.moveTo(x, y - 3);
      pen.lineTo(x, y + 3);
    }
    pen.stroke();
    for (const track of record.tracks) {
      const where = (time - track.from) / track.step, place = at(track.places, where);
      if (!place) continue;
      const k = 3 * Math.min(Math.max(Math.floor(where), 0), track.spread.length / 3 - 1);
      const [xx, xy, yy] = track.spread.slice(k, k + 3), middle = (xx + yy) / 2, apart = Math.hypot((xx - yy) / 2, xy);
      const radius = (share) => Math.max(WITHIN * Math.sqrt(Math.max(share, 0)) * scale, 2), [x, y] = put(...place);
      pen.beginPath();
      pen.ellipse(x, y, radius(middle + apart), radius(middle - apart), record.heading - Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI);
      pen.strokeStyle = colours.sensed;
      pen.lineWidth = 2;
      pen.stroke();
      label(pen, track.number, x + 6, y - 6, "left");
    }
  }

  // How far an instruction is at this instant; null before it is sent and some time after it has ended.
  function stageOf({ sent_s: sent, begun_s: begun, ended_s: ended, fate }) {
    if (time < sent) return null;
    if (begun === null) return time < sent + ALARM_STAYS ? fate : null;
    if (time < begun) return "told";
    if (ended === null || time < ended) return "does so";
    return time < ended + ALARM_STAYS ? fate : null;
  }

  // Who is told what: a ring around the vehicle, solid while it follows the instruction, dashed before and after.
  function drawTold(pen, put, scale, one) {
    const stage = stageOf(one);
    if (!stage || one.shown === null) return;
    const { truth, uv, others, rate, sizes } = record, own = one.shown === "tv" ? [truth, 0, sizes[0]] : [uv, record.from.uv, sizes[1]];
    const { places, from, step, size } = others[one.shown] ?? { places: own[0], from: own[1], step: 1 / rate, size: own[2] };
    const where = (time - from) / step, place = at(places, where);
    if (!place) return;
    const angle = facing(places, where, 1), radius = Math.max(size[0] * scale * 0.7, 9);
    const [x, y] = put(place[0] - (Math.cos(angle) * size[0]) / 2, place[1] - (Math.sin(angle) * size[0]) / 2);
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.strokeStyle = colours.ink;
    pen.lineWidth = 2.5;
    pen.setLineDash(stage === "does so" ? [] : [4, 4]);
    pen.stroke();
    pen.setLineDash([]);
    label(pen, `${one.says} (${stage})`, x, y + radius + 14 * letters, "center", true);
  }

  // What the TV does at this instant: the maneuver that is nearest in time.
  function doing() {
    const away = ([, onset, commit]) => Math.max(onset - time, time - commit, 0);
    const nearest = record.maneuvers.reduce((best, one) => (best && away(best) <= away(one) ? best : one), null);
    if (!nearest) return "no labelled maneuver";
    const [intention, onset, commit, note] = nearest;
    if (intention === "following") return words(intention);
    const phase = time < onset ? "before onset" : time < commit ? "begun" : "committed";
    return `${words(intention)}${note ? ` (${note})` : ""}, ${phase}`;
  }

  // A vehicle from above. place: of its front bumper's centre. angle: where it faces, rad.
  function vehicle(pen, put, scale, place, angle, [length, width], fill, name) {
    const turn = angle - record.heading, [x, y] = put(...place);
    pen.save();
    pen.translate(x, y);
    pen.rotate(-turn);
    pen.beginPath();
    const l = length * scale, w = width * scale, nose = Math.min(l / 3, w);
    pen.moveTo(-l, -w / 2);
    pen.lineTo(-nose / 2, -w / 2);
    pen.lineTo(0, -w / 4);
    pen.lineTo(0, w / 4);
    pen.lineTo(-nose / 2, w / 2);
    pen.lineTo(-l, w / 2);
    pen.closePath();
    pen.fillStyle = fill;
    pen.fill();
    pen.strokeStyle = colours.ground;
    pen.lineWidth = 1;
    pen.stroke();
    pen.restore();
    if (name) label(pen, name, x - (length * scale) / 2, y - width * scale - 3, "center", true);
  }

  function panel(pen, [x, y], angle) {
    pen.save();
    pen.translate(x, y);
    pen.rotate(-(angle - record.heading));
    pen.beginPath();
    pen.moveTo(12, 0);
    pen.lineTo(-6, -7);
    pen.lineTo(-6, 7);
    pen.closePath();
    pen.fillStyle = colours.site;
    pen.fill();
    pen.restore();
  }

  function label(pen, text, x, y, align, strong = false) {
    pen.font = `${strong ? "600 " : ""}${(strong ? 14 : 12) * letters}px system-ui, sans-serif`;
    pen.textAlign = align;
    pen.lineWidth = 3;
    pen.strokeStyle = colours.ground;
    pen.strokeText(text, x, y);
    pen.fillStyle = colours.ink;
    pen.fillText(text, x, y);
  }

  // The lanes near the records, north up, with the sites and the TV's place.
  function drawMap(pen, width, tv) {
    if (width < 600 || !lanes.length) return;
    const every = lanes.flatMap((lane) => lane.points), size = [200, 84];
    const [low, high] = [0, 1].reduce(
      ([a, b], k) => {
        const values = every.map((point) => point[k]);
        return [[...a, values.reduce((p, q) => Math.min(p, q))], [...b, values.reduce((p, q) => Math.max(p, q))]];
      },
      [[], []],
    );
    const scale = Math.min((size[0] - 12) / (high[0] - low[0] || 1), (size[1] - 12) / (high[1] - low[1] || 1));
    const left = width - size[0] - 10, top = 10;
    const put = ([x, y]) => [
      left + size[0] / 2 + scale * (x - (low[0] + high[0]) / 2),
      top + size[1] / 2 - scale * (y - (low[1] + high[1]) / 2),
    ];
    pen.fillStyle = colours.ground;
    pen.fillRect(left, top, ...size);
    pen.strokeStyle = colours.soft;
    pen.lineWidth = 1;
    pen.strokeRect(left, top, ...size);
    for (const { points } of lanes) {
      pen.beginPath();
      points.forEach((point, k) => pen[k ? "lineTo" : "moveTo"](...put(point)));
      pen.stroke();
    }
    const dot = (place, fill, radius) => {
      pen.beginPath();
      pen.arc(...put(place), radius, 0, 2 * Math.PI);
      pen.fillStyle = fill;
      pen.fill();
    };
    for (const [, x, y] of data.sites) if (within([x, y], low, high)) dot([x, y], colours.site, 2.5);
    dot(tv, colours.tv, 4);
  }

  const within = (place, low, high) => place.every((v, k) => v >= low[k] - 60 && v <= high[k] + 60);

  // Marks of classes, so that colour is not all that tells them apart.
  function mark(pen, which, x, y, r = 5) {
    const corners = { square: [4, 0.785], triangle: [3, -1.571], diamond: [4, 0] }[MARKS[which]];
    pen.beginPath();
    if (MARKS[which] === "circle") pen.arc(x, y, r, 0, 2 * Math.PI);
    else if (corners) {
      for (let k = 0; k < corners[0]; k++) {
        const angle = corners[1] + (2 * Math.PI * k) / corners[0];
        pen[k ? "lineTo" : "moveTo"](x + r * Math.cos(angle), y + r * Math.sin(angle));
      }
      pen.closePath();
    } else {
      const arms = MARKS[which] === "cross" ? 2 : 3;
      for (let k = 0; k < arms; k++) {
        const angle = 0.785 + (Math.PI * k) / arms;
        pen.moveTo(x - r * Math.cos(angle), y - r * Math.sin(angle));
        pen.lineTo(x + r * Math.cos(angle), y + r * Math.sin(angle));
      }
      pen.lineWidth = 2.5;
      pen.stroke();
      return;
    }
    pen.fill();
  }

  function stroke(pen, x0, y0, x1, y1, style, dash = []) {
    pen.strokeStyle = style;
    pen.lineWidth = 1;
    pen.setLineDash(dash);
    pen.beginPath();
    pen.moveTo(x0, y0);
    pen.lineTo(x1, y1);
    pen.stroke();
    pen.setLineDash([]);
  }

  // A line up to the present time, with its class's or its own mark at the end. value: of the window k.
  function curve(pen, which, count, value, x, y) {
    const { from, step } = record.answers;
    pen.strokeStyle = pen.fillStyle = colours.classes[which % MARKS.length];
    pen.lineWidth = 2;
    pen.setLineDash(DASHES[which % DASHES.length]);
    pen.beginPath();
    let end = null;
    for (let k = 0; k < count; k++) {
      const t = from + k * step, place = [x(t), y(value(k))];
      if (t > time + 1e-6) break;
      pen[k ? "lineTo" : "moveTo"](...place);
      end = place;
    }
    pen.stroke();
    pen.setLineDash([]);
    if (end) mark(pen, which % MARKS.length, ...end);
  }

  // What the modules of a network do with the windows: a chart for each.
  function drawInside() {
    if (!inside) return;
    const modules = record.answers.inside, [pen, width, height] = sized(inside, 110 * Math.max(modules.length, 1));
    const left = 40, right = width - 12, x = (t) => left + ((right - left) * t) / record.duration;
    pen.fillStyle = colours.ground;
    pen.fillRect(0, 0, width, height);
    modules.forEach(({ title, top: most, names, lines }, k) => {
      const top = 110 * k + 24, bottom = 110 * k + 100, y = (share) => bottom - (bottom - top) * share;
      for (const share of [0, 1]) {
        stroke(pen, left, y(share), right, y(share), colours.line);
        label(pen, String(most * share), left - 6, y(share) + 4, "right");
      }
      for (const maneuver of record.maneuvers) {
        for (const t of maneuver.slice(1, 3)) if (t >= 0 && t <= record.duration) stroke(pen, x(t), top, x(t), bottom, colours.soft, [2, 3]);
      }
      label(pen, title, left, top - 8, "left");
      let beside = left + pen.measureText(title).width + 18;
      names.forEach((name, which) => {
        pen.fillStyle = pen.strokeStyle = colours.classes[which % MARKS.length];
        mark(pen, which % MARKS.length, beside, top - 12);
        label(pen, name, beside + 9, top - 8, "left");
        beside += pen.measureText(name).width + 30;
        curve(pen, which, lines[which].length, (window) => lines[which][window] / 255, x, y);
      });
      stroke(pen, x(time), top, x(time), bottom, colours.ink);
    });
  }

  function drawAnswers() {
    if (!answers) return;
    const [pen, width, height] = sized(answers, 220), left = 40, right = width - 12, top = 22, bottom = height - 36;
    pen.fillStyle = colours.ground;
    pen.fillRect(0, 0, width, height);
    const x = (t) => left + ((right - left) * t) / record.duration, y = (p) => bottom - (bottom - top) * p;
    const line = (...ends) => stroke(pen, ...ends);
    for (const share of [0, 0.5, 1]) {
      line(left, y(share), right, y(share), colours.line);
      label(pen, String(share), left - 6, y(share) + 4, "right");
    }
    for (const maneuver of record.maneuvers) {
      ["onset", "commit"].forEach((name, k) => {
        const t = maneuver[k + 1];
        if (t < 0 || t > record.duration) return;
        line(x(t), top, x(t), bottom, colours.soft, k ? [2, 3] : [6, 4]);
        label(pen, name, x(t) + (k ? 3 : -3), top - 6, k ? "left" : "right");
      });
    }
    label(pen, "end of the window, s after the start", (left + right) / 2, height - 5, "center");
    for (let t = 0; t <= record.duration; t++) label(pen, String(t), x(t), bottom + 14, "center");
    const { probabilities } = record.answers, count = probabilities.length / data.classes.length;
    data.classes.forEach((_, which) => {
      curve(pen, which, count, (k) => probabilities[k * data.classes.length + which] / 255, x, y);
    });
    for (const [intention, t, wrong] of record.alarms) {
      if (t > time + 1e-6) continue;
      const which = Math.max(data.classes.indexOf(intention), 0) % MARKS.length;
      pen.fillStyle = pen.strokeStyle = colours.classes[which];
      line(x(t), top, x(t), bottom, colours.classes[which]);
      mark(pen, which, x(t), top + 6, 7);
      const late = t > record.duration / 2;
      label(pen, wrong === null ? "alarm" : wrong ? "✗ alarm" : "✓ alarm", x(t) + (late ? -9 : 9), top + 11, late ? "right" : "left", true);
    }
    line(x(time), top, x(time), bottom, colours.ink);
  }

  function drawLegend() {
    const legend = element("replay-legend");
    if (!legend) return;
    legend.replaceChildren(
      ...data.classes.map((name, which) => {
        const item = document.createElement("li"), sign = document.createElement("canvas");
        sign.width = 48;
        sign.height = 16;
        sign.setAttribute("aria-hidden", "true");
        const pen = sign.getContext("2d");
        pen.strokeStyle = pen.fillStyle = colours.classes[which % MARKS.length];
        pen.lineWidth = 2;
        pen.setLineDash(DASHES[which % DASHES.length]);
        pen.beginPath();
        pen.moveTo(0, 8);
        pen.lineTo(36, 8);
        pen.stroke();
        pen.setLineDash([]);
        mark(pen, which % MARKS.length, 40, 8);
        item.append(sign, words(name));
        return item;
      }),
    );
  }

  function describe() {
    const { about, answers: given, others } = record;
    let said = `${about} `;
    if (others.length) said += `${others.length} other ${others.length === 1 ? "vehicle" : "vehicles"} near. `;
    if (record.tracks) said += `${record.tracks.length} ${record.tracks.length === 1 ? "track" : "tracks"} of the network near. `;
    if (given && given.predicted && data.noun === "record") {
      const verdict = given.wrong === null ? "" : given.wrong ? " – wrong" : " – correct";
      said += `Predictor at the last measured window: ${words(given.predicted)}${verdict}.`;
    }
    status.textContent = said;
  }

  function draw() {
    drawRoad();
    drawAnswers();
    drawInside();
    slider.value = String(Math.round((1000 * time) / record.duration));
    slider.setAttribute("aria-valuetext", `${time.toFixed(2)} s`);
    element("replay-clock").textContent = `${time.toFixed(2)} s`;
    road.dataset.frames = String(++frames);
    road.dataset.time = time.toFixed(3);
  }

  function seek(to) {
    time = Math.min(Math.max(to, 0), record.duration);
    draw();
  }

  function choose(which) {
    number = (which + data.records.length) % data.records.length;
    record = unpacked(number);
    picker.value = String(number);
    road.dataset.record = record.id;
    describe();
    seek(0);
  }

  function play(on) {
    playing = on;
    playButton.textContent = on ? "Pause" : "Play";
    if (!on) return;
    if (time >= record.duration) time = 0;
    last = performance.now();
    requestAnimationFrame(tick);
  }

  function tick(now) {
    if (!playing) return;
    const passed = (Math.max(now - last, 0) / 1000) * Number(element("replay-speed").value);
    last = now;
    seek(time + passed);
    if (time >= record.duration) play(false);
    else requestAnimationFrame(tick);
  }

  function nextWrong() {
    for (let k = 1; k <= data.records.length; k++) {
      const which = (number + k) % data.records.length, given = data.records[which].answers;
      if (given && given.wrong) return choose(which);
    }
    status.textContent = "The predictor is wrong in none of these records.";
  }

  const KEYS = {
    " ": () => play(!playing),
    ArrowLeft: (event) => seek(time - (event.shiftKey ? 0.5 : 0.04)),
    ArrowRight: (event) => seek(time + (event.shiftKey ? 0.5 : 0.04)),
    ArrowUp: () => choose(number - 1),
    ArrowDown: () => choose(number + 1),
    Home: () => seek(0),
    End: () => seek(record.duration),
    w: () => nextWrong(),
    "+": () => { zoom = Math.min(zoom * 1.25, 8); draw(); },
    "-": () => { zoom = Math.max(zoom / 1.25, 0.2); draw(); },
  };
  document.addEventListener("keydown", (event) => {
    const inside = element("replay-section").contains(event.target);
    if (!inside && event.target !== document.body) return;
    const inControl = event.target !== road && /^(SELECT|INPUT|BUTTON)$/.test(event.target.tagName);
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in KEYS) || (inControl && event.key !== "w")) return;
    event.preventDefault();
    KEYS[event.key](event);
  });
  playButton.addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => { play(false); seek((record.duration * slider.value) / 1000); });
  picker.addEventListener("change", () => choose(Number(picker.value)));
  element("replay-before").addEventListener("click", () => choose(number - 1));
  element("replay-after").addEventListener("click", () => choose(number + 1));
  element("replay-wrong")?.addEventListener("click", nextWrong);
  document.addEventListener("replay-show", (event) => {
    const which = data.records.findIndex((one) => one.id === event.detail);
    if (which >= 0) { choose(which); road.focus(); }
  });
  const repaint = () => { readColours(); drawLegend(); draw(); };
  readColours();
  drawLegend();
  choose(0);
  new ResizeObserver(draw).observe(road);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  document.addEventListener("theme-change", repaint);
})();
