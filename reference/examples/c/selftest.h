/* Checks, networks and a small global side for selftest.c. */
#ifndef PAPER_MODEL_SELFTEST_H
#define PAPER_MODEL_SELFTEST_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

/* ---- Checks --------------------------------------------------------------------------------------------------- */

static int failures = 0;

/* Passes where value <= limit; a value that is not a number fails. */
static void at_most(const char *what, double value, double limit) {
  const bool pass = value <= limit;
  printf("%s  %-74s %.3g (limit %.3g)\n", pass ? "pass" : "FAIL", what, value, limit);
  if (!pass) failures++;
}

static void holds(const char *what, bool pass) {
  printf("%s  %s\n", pass ? "pass" : "FAIL", what);
  if (!pass) failures++;
}

/* ---- Allocations: the linker sends every call of the library here --------------------------------------------- */

static uint64_t allocations = 0;
void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_malloc(size_t size) {
  allocations++;
  return __real_malloc(size);
}
void *__wrap_calloc(size_t count, size_t size) {
  allocations++;
  return __real_calloc(count, size);
}

/* ---- Networks ------------------------------------------------------------------------------------------------- */

#define MOST_NODES 128
#define MOST_SPRINGS 1024
#define MOST_TRIANGLES 256

typedef struct network {
  stickslip_body body;
  double rest[3 * MOST_NODES], mass[MOST_NODES];
  uint8_t fixed[MOST_NODES];
  uint32_t spring_nodes[2 * MOST_SPRINGS], triangle_nodes[3 * MOST_TRIANGLES];
  double stiffness[MOST_SPRINGS], damping[MOST_SPRINGS], rest_length[MOST_SPRINGS];
  double x[3 * MOST_NODES], v[3 * MOST_NODES]; /* the state of the whole network */
} network;

static void start_network(network *net) {
  memset(net, 0, sizeof *net);
  net->body = (stickslip_body){.size = sizeof net->body,
                               .rest = net->rest,
                               .mass = net->mass,
                               .fixed = net->fixed,
                               .spring_nodes = net->spring_nodes,
                               .stiffness = net->stiffness,
                               .damping = net->damping,
                               .rest_length = net->rest_length,
                               .triangle_nodes = net->triangle_nodes};
}

static uint32_t add_node(network *net, double x, double y, double z, double mass, bool fixed) {
  const uint32_t i = (uint32_t)net->body.nodes++;
  if (i >= MOST_NODES) abort();
  set_row(net->rest, i, (vec3){x, y, z});
  set_row(net->x, i, (vec3){x, y, z});
  net->mass[i] = mass;
  net->fixed[i] = fixed;
  return i;
}

static void join(network *net, uint32_t i, uint32_t j, double k, double c) {
  const uint64_t s = net->body.springs++;
  if (s >= MOST_SPRINGS) abort();
  net->spring_nodes[2 * s] = i, net->spring_nodes[2 * s + 1] = j;
  net->stiffness[s] = k, net->damping[s] = c;
  net->rest_length[s] = length(subtract(row(net->rest, j), row(net->rest, i)));
}

static void add_triangle(network *net, uint32_t a, uint32_t b, uint32_t c) {
  uint32_t *corner = net->triangle_nodes + 3 * net->body.triangles++;
  if (net->body.triangles > MOST_TRIANGLES) abort();
  corner[0] = a, corner[1] = b, corner[2] = c;
}

enum { NX = 5, NY = 5, NZ = 3 };
static const double SPACING = 0.0125;

static uint32_t block_node(int ix, int iy, int iz) { return (uint32_t)((iz * NY + iy) * NX + ix); }

/* Two triangles between four nodes, counterclockwise seen from outside. */
static void add_square(network *net, uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
  add_triangle(net, a, b, c);
  add_triangle(net, a, c, d);
}

/* A block of 5 x 5 x 3 nodes with edges and face diagonals, its top at z = 0 and its bottom fixed. */
static void make_block(network *net) {
  start_network(net);
  for (int iz = 0; iz < NZ; iz++)
    for (int iy = 0; iy < NY; iy++)
      for (int ix = 0; ix < NX; ix++)
        add_node(net, (ix - 2) * SPACING, (iy - 2) * SPACING, (iz - 2) * SPACING, 0.01, iz == 0);
  for (uint32_t i = 0; i < net->body.nodes; i++)
    for (uint32_t j = i + 1; j < net->body.nodes; j++)
      if (length(subtract(row(net->rest, j), row(net->rest, i))) < 1.5 * SPACING) join(net, i, j, 100.0, 0.5);
  for (int a = 0; a + 1 < NX; a++) {
    for (int b = 0; b + 1 < NY; b++) {
      add_square(net, block_node(a, b, 2), block_node(a + 1, b, 2), block_node(a + 1, b + 1, 2),
                 block_node(a, b + 1, 2));
      add_square(net, block_node(a, b, 0), block_node(a, b + 1, 0), block_node(a + 1, b + 1, 0),
                 block_node(a + 1, b, 0));
    }
    for (int c = 0; c + 1 < NZ; c++) {
      add_square(net, block_node(a, 0, c), block_node(a + 1, 0, c), block_node(a + 1, 0, c + 1),
                 block_node(a, 0, c + 1));
      add_square(net, block_node(a, 4, c), block_node(a, 4, c + 1), block_node(a + 1, 4, c + 1),
                 block_node(a + 1, 4, c));
      add_square(net, block_node(0, a, c), block_node(0, a, c + 1), block_node(0, a + 1, c + 1),
                 block_node(0, a + 1, c));
      add_square(net, block_node(4, a, c), block_node(4, a + 1, c), block_node(4, a + 1, c + 1),
                 block_node(4, a, c + 1));
    }
  }
}

/* A triangle at z = 0, each corner a mass on a vertical chain of `links` equal springs and masses above a fixed
 * node. Node 0, 1, 2 are the corners. */
static void make_columns(network *net, int links, double mass, double k, double c) {
  static const double corner[3][2] = {{0.02, 0.0}, {-0.01, 0.02}, {-0.01, -0.02}};
  start_network(net);
  for (int i = 0; i < 3; i++) add_node(net, corner[i][0], corner[i][1], 0.0, mass, false);
  for (int i = 0; i < 3; i++)
    for (uint32_t above = (uint32_t)i, link = 1; link <= (uint32_t)links; link++) {
      const uint32_t below =
          add_node(net, corner[i][0], corner[i][1], -0.01 * (double)link, mass, link == (uint32_t)links);
      join(net, above, below, k, c);
      above = below;
    }
  add_triangle(net, 0, 1, 2);
}

/* ---- A session: the global side in small ---------------------------------------------------------------------- */

static const double TICK = 1e-3;

typedef struct session {
  network *net;
  void *renderer;
  stickslip_output output;
  vec3 tip;
  uint64_t tick;
  uint64_t allocated; /* within ticks */
} session;

static stickslip_setup setup_for(int32_t law, double friction, double adhesion, const char *options) {
  return (stickslip_setup){.size = sizeof(stickslip_setup),
                           .tick_s = TICK,
                           .cycle_s = 0.1,
                           .law = law,
                           .surface = STICKSLIP_SURFACE_FACETED,
                           .friction_static = friction,
                           .friction_kinetic = friction,
                           .adhesion = adhesion,
                           .options = options};
}

/* Builds a model from the network's state and swaps it in. */
static void hand_over(session *s) {
  const double tip[3] = {s->tip.x, s->tip.y, s->tip.z};
  stickslip_state state = {.size = sizeof state, .tick = s->tick, .x = s->net->x, .v = s->net->v, .tip = tip};
  state.mode = s->output.mode, state.triangle = s->output.triangle;
  memcpy(state.weights, s->output.weights, sizeof state.weights);
  memcpy(state.normal, s->output.normal, sizeof state.normal);
  void *model = stickslip_renderer_build(s->renderer, &state);
  if (!model) abort();
  stickslip_renderer_dispose(stickslip_renderer_swap(s->renderer, model));
}

static session start(network *net, vec3 tip, stickslip_setup setup) {
  session s = {.net = net, .tip = tip, .output = {.size = sizeof s.output}};
  s.renderer = stickslip_renderer_create(&net->body, &setup);
  if (!s.renderer) abort();
  hand_over(&s);
  return s;
}

static void end(session *s) { stickslip_renderer_destroy(s->renderer); }

/* One tick; the patch is copied back to the network. Returns the force. */
static vec3 tick(session *s, vec3 to) {
  const double before[3] = {s->tip.x, s->tip.y, s->tip.z}, tip[3] = {to.x, to.y, to.z};
  const uint64_t allocated = allocations;
  const int32_t fault = stickslip_renderer_tick(s->renderer, before, tip, &s->output);
  s->allocated += allocations - allocated;
  uint32_t nodes[MOST_NODES];
  double x[3 * MOST_NODES], v[3 * MOST_NODES];
  const uint64_t count = stickslip_renderer_moved(s->renderer, MOST_NODES, nodes, x, v);
  if (fault || count > MOST_NODES) abort();
  for (uint32_t i = 0; i < count; i++) {
    set_row(s->net->x, nodes[i], row(x, i));
    set_row(s->net->v, nodes[i], row(v, i));
  }
  s->tip = to;
  s->tick++;
  return vector(s->output.force);
}

static vec3 contact_point(const session *s) {
  vec3 p = {0.0, 0.0, 0.0};
  for (int k = 0; k < 3; k++)
    p = add(p, scale(s->output.weights[k], row(s->net->x, s->net->triangle_nodes[3 * s->output.triangle + k])));
  return p;
}

/* A place between the grid's lines, 1.2 s: 0.1 s above the surface, a press of 3 mm, a drag of 15 mm, a lift. */
static vec3 drag_path(uint64_t i) {
  const double t = (double)i * TICK;
  vec3 q = {-0.0077, 0.0013, 0.002};
  if (t > 0.1) q.z -= 0.005 * fmin(1.0, (t - 0.1) / 0.2);
  if (t > 0.3) q.x += 0.015 * fmin(1.0, (t - 0.3) / 0.6);
  if (t > 0.9) q.z += 0.005 * fmin(1.0, (t - 0.9) / 0.2);
  return q;
}
enum { DRAG_TICKS = 1200 };

/* Drags over a fresh block, with a hand-over every 100 ticks. Fills `force` with DRAG_TICKS forces. */
static session drag(network *net, stickslip_setup setup, vec3 *force, int32_t *mode) {
  make_block(net);
  session s = start(net, drag_path(0), setup);
  for (uint64_t i = 0; i < DRAG_TICKS; i++) {
    if (i > 0 && i % 100 == 0) hand_over(&s);
    force[i] = tick(&s, drag_path(i + 1));
    if (mode) mode[i] = s.output.mode;
  }
  return s;
}

#endif
