/* The surface of the body: a mesh of flat triangles. */
#include "model.h"

#include <stdlib.h>

/* A crossing counts as inside its triangle down to this barycentric weight, so that no path slips between two
 * triangles. */
static const double WEIGHT_TOLERANCE = 1e-9;
/* Crossings within this share of a tick are simultaneous: neighbours give the same time but for round-off. */
static const double TIME_TOLERANCE = 1e-12;
/* m^2: squared distances within this are equal. */
static const double DISTANCE_TOLERANCE = 1e-18;
/* A tip at the start of a tick counts as outside down to this depth, relative to the size of the triangle: a tip that
 * lies on the surface must not fall through it by round-off. */
static const double DEPTH_TOLERANCE = 1e-12;

/* ---- Connectivity --------------------------------------------------------------------------------------------- */

typedef struct half_edge {
  uint32_t low, high; /* its nodes */
  uint32_t triangle, corner;
} half_edge;

static int compare_half_edges(const void *left, const void *right) {
  const half_edge *a = left, *b = right;
  if (a->low != b->low) return a->low < b->low ? -1 : 1;
  if (a->high != b->high) return a->high < b->high ? -1 : 1;
  if (a->triangle != b->triangle) return a->triangle < b->triangle ? -1 : 1;
  return a->corner < b->corner ? -1 : a->corner > b->corner;
}

bool surface_create(surface *s, const stickslip_body *body, double size) {
  const uint32_t triangles = (uint32_t)body->triangles, edges = 3 * triangles;
  s->triangles = triangles;
  s->corner = body->triangle_nodes;
  s->margin = 1e-8 * size;
  s->neighbour = malloc((edges + 1) * sizeof *s->neighbour);
  s->incident_start = calloc(body->nodes + 2, sizeof *s->incident_start);
  s->incident = malloc((edges + 1) * sizeof *s->incident);
  s->visited = calloc(triangles + 1, sizeof *s->visited);
  s->measure = calloc(triangles + 1, sizeof *s->measure);
  half_edge *list = malloc((edges + 1) * sizeof *list);
  if (!s->neighbour || !s->incident_start || !s->incident || !s->visited || !s->measure || !list) {
    free(list);
    return false;
  }

  for (uint32_t e = 0; e < edges; e++) {
    const uint32_t t = e / 3, k = e % 3;
    const uint32_t a = s->corner[3 * t + (k + 1) % 3], b = s->corner[3 * t + (k + 2) % 3];
    list[e] = (half_edge){a < b ? a : b, a < b ? b : a, t, k};
    s->neighbour[e] = NONE;
  }
  qsort(list, edges, sizeof *list, compare_half_edges);
  for (uint32_t e = 0; e + 1 < edges; e++) {
    const half_edge *a = &list[e], *b = &list[e + 1];
    if (a->low != b->low || a->high != b->high) continue;
    s->neighbour[3 * a->triangle + a->corner] = b->triangle;
    s->neighbour[3 * b->triangle + b->corner] = a->triangle;
    e++;
  }
  free(list);

  /* Counts are shifted by two places, so that filling the list leaves the starts behind. */
  uint32_t *start = s->incident_start;
  for (uint32_t e = 0; e < edges; e++) start[s->corner[e] + 2]++;
  for (uint64_t i = 2; i < body->nodes + 2; i++) start[i] += start[i - 1];
  for (uint32_t e = 0; e < edges; e++) s->incident[start[s->corner[e] + 1]++] = e / 3;
  return true;
}

void surface_destroy(surface *s) {
  free(s->neighbour);
  free(s->incident_start);
  free(s->incident);
  free(s->visited);
  free(s->measure);
}

/* ---- Points and normals --------------------------------------------------------------------------------------- */

static void corners(const surface *s, const double *x, uint32_t triangle, vec3 corner[3]) {
  for (int k = 0; k < 3; k++) corner[k] = row(x, s->corner[3 * (size_t)triangle + k]);
}

vec3 surface_position(const surface *s, const double *x, const surface_point *at) {
  vec3 c[3];
  corners(s, x, at->triangle, c);
  return add(add(scale(at->weights[0], c[0]), scale(at->weights[1], c[1])), scale(at->weights[2], c[2]));
}

vec3 surface_normal(const surface *s, const double *x, uint32_t triangle) {
  vec3 c[3];
  corners(s, x, triangle, c);
  return unit(cross(subtract(c[1], c[0]), subtract(c[2], c[0])));
}

/* Barycentric weights of the projection of q onto the plane of a triangle. */
static void weights_in(const vec3 c[3], vec3 q, double weights[3]) {
  const vec3 e1 = subtract(c[1], c[0]), e2 = subtract(c[2], c[0]), r = subtract(q, c[0]);
  const vec3 normal = cross(e1, e2);
  const double square = dot(normal, normal);
  weights[1] = dot(cross(r, e2), normal) / square;
  weights[2] = dot(cross(e1, r), normal) / square;
  weights[0] = 1.0 - weights[1] - weights[2];
}

bool surface_project(surface *s, const double *x, vec3 q, surface_point *at) {
  uint32_t t = at->triangle;
  s->walk++;
  for (;;) {
    vec3 c[3];
    s->visited[t] = s->walk;
    corners(s, x, t, c);
    at->triangle = t;
    weights_in(c, q, at->weights);
    int lowest = 0;
    for (int k = 1; k < 3; k++)
      if (at->weights[k] < at->weights[lowest]) lowest = k;
    if (at->weights[lowest] >= 0.0) return true;

    const uint32_t next = s->neighbour[3 * (size_t)t + lowest];
    if (next == NONE) return false;
    if (s->visited[next] == s->walk) {
      /* A valley: both projections leave their triangle over this edge. The contact lies on the edge. */
      const int a = (lowest + 1) % 3, b = (lowest + 2) % 3;
      const vec3 edge = subtract(c[b], c[a]);
      double along = dot(subtract(q, c[a]), edge) / dot(edge, edge);
      along = along < 0.0 ? 0.0 : along > 1.0 ? 1.0 : along;
      const uint32_t node_a = s->corner[3 * (size_t)t + a], node_b = s->corner[3 * (size_t)t + b];
      at->triangle = t < next ? t : next;
      for (int k = 0; k < 3; k++) {
        const uint32_t node = s->corner[3 * (size_t)at->triangle + k];
        at->weights[k] = node == node_a ? 1.0 - along : node == node_b ? along : 0.0;
      }
      return true;
    }
    t = next;
  }
}

/* ---- Nearest point -------------------------------------------------------------------------------------------- */

/* The part of a triangle on which a point lies: the edge or the corner with number `k`. */
typedef struct feature {
  enum { FACE, EDGE, CORNER } kind;
  int k;
} feature;

/* Nearest point of a triangle by its Voronoi regions (Ericson, Real-Time Collision Detection, 5.1.5). */
static double nearest_in_triangle(const vec3 c[3], vec3 q, double weights[3], feature *on) {
  const vec3 ab = subtract(c[1], c[0]), ac = subtract(c[2], c[0]);
  const vec3 aq = subtract(q, c[0]), bq = subtract(q, c[1]), cq = subtract(q, c[2]);
  const double d1 = dot(ab, aq), d2 = dot(ac, aq), d3 = dot(ab, bq), d4 = dot(ac, bq), d5 = dot(ab, cq),
               d6 = dot(ac, cq);
  const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  double w1, w2;
  if (d1 <= 0.0 && d2 <= 0.0) {
    *on = (feature){CORNER, 0}, w1 = 0.0, w2 = 0.0;
  } else if (d3 >= 0.0 && d4 <= d3) {
    *on = (feature){CORNER, 1}, w1 = 1.0, w2 = 0.0;
  } else if (d6 >= 0.0 && d5 <= d6) {
    *on = (feature){CORNER, 2}, w1 = 0.0, w2 = 1.0;
  } else if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
    *on = (feature){EDGE, 2}, w1 = d1 / (d1 - d3), w2 = 0.0;
  } else if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
    *on = (feature){EDGE, 1}, w1 = 0.0, w2 = d2 / (d2 - d6);
  } else if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
    *on = (feature){EDGE, 0}, w2 = (d4 - d3) / ((d4 - d3) + (d5 - d6)), w1 = 1.0 - w2;
  } else {
    *on = (feature){FACE, 0}, w1 = vb / (va + vb + vc), w2 = vc / (va + vb + vc);
  }
  weights[0] = 1.0 - w1 - w2, weights[1] = w1, weights[2] = w2;
  const vec3 point = add(c[0], add(scale(w1, ab), scale(w2, ac)));
  const vec3 away = subtract(q, point);
  return dot(away, away);
}

/* The angle-weighted pseudonormal of a feature: its sign tells outside from inside. */
static vec3 pseudonormal(const surface *s, const double *x, uint32_t triangle, feature on) {
  vec3 normal = surface_normal(s, x, triangle);
  if (on.kind == EDGE) {
    const uint32_t other = s->neighbour[3 * (size_t)triangle + on.k];
    if (other != NONE) normal = add(normal, surface_normal(s, x, other));
  } else if (on.kind == CORNER) {
    const uint32_t node = s->corner[3 * (size_t)triangle + on.k];
    normal = (vec3){0.0, 0.0, 0.0};
    for (uint32_t i = s->incident_start[node]; i < s->incident_start[node + 1]; i++) {
      const uint32_t t = s->incident[i];
      vec3 c[3];
      corners(s, x, t, c);
      const int k = s->corner[3 * (size_t)t] == node ? 0 : s->corner[3 * (size_t)t + 1] == node ? 1 : 2;
      const vec3 one = subtract(c[(k + 1) % 3], c[k]), two = subtract(c[(k + 2) % 3], c[k]);
      const double angle = atan2(length(cross(one, two)), dot(one, two));
      normal = add(normal, scale(angle, surface_normal(s, x, t)));
    }
  }
  return normal;
}

double surface_nearest(surface *s, const double *x, vec3 q, surface_point *at) {
  uint32_t nearest = 0;
  double least = INFINITY, weights[3];
  vec3 c[3];
  feature on;
  for (uint32_t t = 0; t < s->triangles; t++) {
    corners(s, x, t, c);
    s->measure[t] = nearest_in_triangle(c, q, weights, &on);
    if (s->measure[t] < least) least = s->measure[t], nearest = t;
  }

  /* The sign is that of the nearest feature, whichever triangle a tie gives below. */
  corners(s, x, nearest, c);
  nearest_in_triangle(c, q, weights, &on);
  const surface_point point = {nearest, {weights[0], weights[1], weights[2]}};
  const double side = dot(subtract(q, surface_position(s, x, &point)), pseudonormal(s, x, nearest, on));

  uint32_t lowest = 0;
  while (lowest < nearest && !(s->measure[lowest] <= least + DISTANCE_TOLERANCE)) lowest++;
  at->triangle = lowest;
  corners(s, x, lowest, c);
  nearest_in_triangle(c, q, at->weights, &on);
  return side > 0.0 ? sqrt(least) : side < 0.0 ? -sqrt(least) : 0.0;
}

/* ---- Collision in time ---------------------------------------------------------------------------------------- */

static double polynomial(const double c[4], double t) { return ((c[3] * t + c[2]) * t + c[1]) * t + c[0]; }

/* The places in (0, 1) at which the cubic has zero slope, ascending. Between them it is monotone. */
static int turning_points(const double c[4], double at[2]) {
  const double a = 3.0 * c[3], half_b = c[2], constant = c[1];
  double root[2];
  int roots = 0, kept = 0;
  const double discriminant = half_b * half_b - a * constant;
  if (discriminant < 0.0) return 0;
  const double sum = -(half_b + copysign(sqrt(discriminant), half_b));
  if (a != 0.0) root[roots++] = sum / a;
  if (sum != 0.0) root[roots++] = constant / sum;
  if (roots == 2 && root[0] > root[1]) {
    const double swap = root[0];
    root[0] = root[1], root[1] = swap;
  }
  for (int i = 0; i < roots; i++)
    if (root[i] > 0.0 && root[i] < 1.0) at[kept++] = root[i];
  return kept;
}

/* The zero of a cubic that falls from a value >= 0 at `low` to a value < 0 at `high`, by bisection to round-off. */
static double falling_root(const double c[4], double low, double high) {
  for (int i = 0; i < 200; i++) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    if (polynomial(c, middle) >= 0.0) low = middle;
    else high = middle;
  }
  return low;
}

/* A box with sides along the axes. */
typedef struct box {
  vec3 low, high;
} box;

static double lesser(double a, double b) { return a < b ? a : b; }
static double greater(double a, double b) { return a > b ? a : b; }

static box around(box b, vec3 point) {
  b.low = (vec3){lesser(b.low.x, point.x), lesser(b.low.y, point.y), lesser(b.low.z, point.z)};
  b.high = (vec3){greater(b.high.x, point.x), greater(b.high.y, point.y), greater(b.high.z, point.z)};
  return b;
}

static bool apart(box a, box b, double margin) {
  return a.low.x > b.high.x + margin || b.low.x > a.high.x + margin || a.low.y > b.high.y + margin ||
         b.low.y > a.high.y + margin || a.low.z > b.high.z + margin || b.low.z > a.high.z + margin;
}

/* First time at which the tip passes a moving triangle from outside to inside. The signed volume of tip and triangle,
 * (q - a) . (b - a) x (c - a), is a cubic in time. */
static double crossing(const vec3 from[3], const vec3 to[3], vec3 q0, vec3 q1, double weights[3]) {
  const vec3 r = subtract(q0, from[0]), r_dot = subtract(subtract(q1, to[0]), r);
  const vec3 e1 = subtract(from[1], from[0]), e1_dot = subtract(subtract(to[1], to[0]), e1);
  const vec3 e2 = subtract(from[2], from[0]), e2_dot = subtract(subtract(to[2], to[0]), e2);
  const vec3 n0 = cross(e1, e2), n1 = add(cross(e1, e2_dot), cross(e1_dot, e2)), n2 = cross(e1_dot, e2_dot);
  const double c[4] = {dot(r, n0), dot(r_dot, n0) + dot(r, n1), dot(r_dot, n1) + dot(r, n2), dot(r_dot, n2)};
  const double depth = DEPTH_TOLERANCE * length(n0) * sqrt(length(n0));

  double end[3];
  int ends = turning_points(c, end);
  end[ends++] = 1.0;
  double low = 0.0;
  for (int i = 0; i < ends; low = end[i++]) {
    const double before = polynomial(c, low), after = polynomial(c, end[i]);
    if (!(after < 0.0) || !(before >= (low == 0.0 ? -depth : 0.0))) continue;
    const double time = before <= 0.0 ? low : falling_root(c, low, end[i]);
    vec3 corner[3];
    for (int k = 0; k < 3; k++) corner[k] = add(from[k], scale(time, subtract(to[k], from[k])));
    weights_in(corner, add(q0, scale(time, subtract(q1, q0))), weights);
    if (weights[0] >= -WEIGHT_TOLERANCE && weights[1] >= -WEIGHT_TOLERANCE && weights[2] >= -WEIGHT_TOLERANCE)
      return time;
  }
  return INFINITY;
}

double surface_collision(surface *s, const double *x, const double *x_end, vec3 q0, vec3 q1, surface_point *at) {
  double earliest = INFINITY, weights[3];
  vec3 from[3], to[3];
  const box tip = around((box){q0, q0}, q1);
  for (uint32_t t = 0; t < s->triangles; t++) {
    corners(s, x, t, from);
    corners(s, x_end, t, to);
    box swept = {from[0], from[0]};
    for (int k = 0; k < 3; k++) swept = around(around(swept, from[k]), to[k]);
    s->measure[t] = apart(tip, swept, s->margin) ? INFINITY : crossing(from, to, q0, q1, weights);
    if (s->measure[t] < earliest) earliest = s->measure[t];
  }
  if (earliest == INFINITY) return INFINITY;
  uint32_t first = 0;
  while (!(s->measure[first] <= earliest + TIME_TOLERANCE)) first++;
  corners(s, x, first, from);
  corners(s, x_end, first, to);
  at->triangle = first;
  return crossing(from, to, q0, q1, at->weights);
}
