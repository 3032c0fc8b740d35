/*
 * Drives the renderer through stickslip_renderer.h alone, against closed forms and invariants, on small networks that
 * are built here. Two tests look inside: at the surface, and at K and D, which are compared with differences of the
 * nonlinear forces.
 */
#include "selftest.h"

/* ---- Tests ---------------------------------------------------------------------------------------------------- */

/* Two masses that swing freely on a chain. Each mode of semi-implicit Euler (11) is x_k = A cos(k a) + B sin(k a) with
 * cos a = 1 - (w h)^2/2. */
static void two_free_masses(void) {
  const double k = 80.0, mass = 0.02, golden[2] = {(3.0 - sqrt(5.0)) / 2.0, (3.0 + sqrt(5.0)) / 2.0};
  static network net;
  make_columns(&net, 2, mass, k, 0.0);
  /* Nodes 0 and 3 are the upper and the lower mass of a column. The modes of the chain are (1, lower/upper). */
  const double upper = 1e-3, lower = -4e-4;
  net.x[2] += upper, net.x[3 * 3 + 2] += lower;
  session s = start(&net, (vec3){0.0, 0.0, 0.1}, setup_for(STICKSLIP_LAW_STICKING, 0.0, 0.0, "rings=all"));
  double error = 0.0;
  for (int i = 1; i <= 500; i++) {
    tick(&s, s.tip);
    double expected = 0.0;
    for (int a = 0; a < 2; a++) {
      /* m w^2 (1, r) = k (1 - r, 2 r - 1), so r = 1 - m w^2/k. */
      const double r = 1.0 - golden[a], amplitude = (upper + r * lower) / (1.0 + r * r);
      const double square = golden[a] * k / mass * TICK * TICK, angle = acos(1.0 - 0.5 * square);
      const double B = amplitude * ((1.0 - square) - cos(angle)) / sin(angle);
      expected += amplitude * cos(i * angle) + B * sin(i * angle);
    }
    error = fmax(error, fabs(net.x[2] - expected));
  }
  end(&s);
  at_most("two masses, free: position against the closed form, m", error, 1e-13);
}

/* Columns of two masses pressed at their centre by d in one tick and held. The upper masses stay; the lower ones swing
 * about d/2. With w = 1/3 the multiplier is W f / sum w^2 = 3 f, so that F = 3 k (d - u). */
static void two_pressed_masses(bool hand_overs) {
  const double k = 80.0, mass = 0.02, d = 2e-3;
  static network net;
  make_columns(&net, 2, mass, k, 0.0);
  session s = start(&net, (vec3){0.0, 0.0, 0.0}, setup_for(STICKSLIP_LAW_STICKING, 0.0, INFINITY, "rings=all"));
  const double square = 2.0 * k / mass * TICK * TICK, angle = acos(1.0 - 0.5 * square);
  double error = 0.0;
  for (int i = 0; i < 300; i++) {
    if (hand_overs && i % 10 == 7) hand_over(&s);
    const vec3 force = tick(&s, (vec3){0.0, 0.0, -d});
    const double A = -0.5 * d, B = A * ((1.0 - square) - cos(angle)) / sin(angle);
    const double u = 0.5 * d + A * cos(i * angle) + B * sin(i * angle);
    error = fmax(error, length(subtract(force, (vec3){0.0, 0.0, 3.0 * k * (d - u)})));
  }
  end(&s);
  at_most(hand_overs ? "two masses, pressed, with hand-overs: force against the closed form, N"
                     : "two masses, pressed: force against the closed form, N",
          error, 1e-10);
}

/* A surface that rises meets a tip that falls: the time of collision, and the force after the rewind. */
static void moving_surface(int32_t law) {
  const double k = 80.0, c = 0.05, mass = 0.02, rise = 0.05, fall = 0.3, gap = 1e-4;
  static network net;
  make_columns(&net, 1, mass, k, c);
  for (uint32_t i = 0; i < 3; i++) set_row(net.v, i, (vec3){0.0, 0.0, rise});
  session s = start(&net, (vec3){0.0, 0.0, gap}, setup_for(law, 0.3, 0.0, "rings=all"));
  const vec3 force = tick(&s, (vec3){0.0, 0.0, gap - fall * TICK});
  const double a = -c * rise / mass, v_predicted = rise + TICK * a, share = gap / (TICK * (fall + v_predicted));
  const double depth = fall * TICK - gap, v = rise + share * TICK * a;
  at_most("collision within a tick: force against the closed form, N", fabs(force.z - 3.0 * (k * depth - c * v)),
          1e-10);
  end(&s);
}

/* A number in [-1, 1) of a linear congruential sequence. */
static double drawn(uint32_t *seed) {
  *seed = *seed * 1664525u + 1013904223u;
  return (double)(*seed >> 8) / 8388608.0 - 1.0;
}

/* The surface of the block at rest is that of a box, whose signed distance and first crossing are known. */
static void surface_of_a_box(void) {
  static network net;
  make_block(&net);
  surface s = {0};
  if (!surface_create(&s, &net.body, 0.1)) abort();
  const vec3 centre = {0.0, 0.0, -0.0125};
  const double half[3] = {0.025, 0.025, 0.0125};
  uint32_t seed = 7;
  double distance_error = 0.0, time_error = 0.0, weight_error = 0.0;
  int crossings = 0;
  bool every = true;
  for (int i = 0; i < 20000; i++) {
    const vec3 q0 = {0.04 * drawn(&seed), 0.04 * drawn(&seed), 0.03 * drawn(&seed)};
    const vec3 q1 = {0.04 * drawn(&seed), 0.04 * drawn(&seed), 0.03 * drawn(&seed)};
    surface_point at;

    const vec3 from_centre = subtract(q0, centre);
    const double beyond[3] = {fabs(from_centre.x) - half[0], fabs(from_centre.y) - half[1],
                              fabs(from_centre.z) - half[2]};
    const double inside = fmin(0.0, fmax(beyond[0], fmax(beyond[1], beyond[2])));
    const vec3 outside = {fmax(0.0, beyond[0]), fmax(0.0, beyond[1]), fmax(0.0, beyond[2])};
    const double distance = surface_nearest(&s, net.rest, q0, &at);
    distance_error = fmax(distance_error, fabs(distance - (inside + length(outside))));
    const vec3 nearest = surface_position(&s, net.rest, &at);
    distance_error = fmax(distance_error, fabs(length(subtract(q0, nearest)) - fabs(distance)));

    /* The path enters the box at the last of the planes that it passes inwards, and only from outside. */
    const double start_at[3] = {from_centre.x, from_centre.y, from_centre.z};
    const vec3 motion = subtract(q1, q0);
    const double step[3] = {motion.x, motion.y, motion.z};
    double enter = -INFINITY, leave = INFINITY;
    for (int k = 0; k < 3; k++) {
      const double one = (-half[k] - start_at[k]) / step[k], two = (half[k] - start_at[k]) / step[k];
      enter = fmax(enter, fmin(one, two));
      leave = fmin(leave, fmax(one, two));
    }
    const bool enters = enter >= 0.0 && enter <= 1.0 && enter < leave;
    const double time = surface_collision(&s, net.rest, net.rest, q0, q1, &at);
    if (enters != (time <= 1.0)) every = false;
    if (!enters || !(time <= 1.0)) continue;
    crossings++;
    time_error = fmax(time_error, fabs(time - enter));
    weight_error =
        fmax(weight_error, length(subtract(surface_position(&s, net.rest, &at), add(q0, scale(time, motion)))));
  }
  holds("a box: 20000 random paths collide where they enter, and no others", every && crossings > 2000);
  at_most("a box: time of collision, share of the tick", time_error, 1e-13);
  at_most("a box: place of collision, m", weight_error, 1e-15);
  at_most("a box: signed distance, m", distance_error, 1e-15);

  /* A contact that is dragged over an edge of the box follows the tip to the next side, and back. */
  surface_point at = {0, {0.3, 0.3, 0.4}};
  const bool found = surface_project(&s, net.rest, (vec3){0.021, 0.001, -0.003}, &at);
  const vec3 p = surface_position(&s, net.rest, &at);
  at_most("a box: projection across triangles, m",
          found ? length(subtract(p, (vec3){0.021, 0.001, 0.0})) : INFINITY, 1e-15);
  surface_destroy(&s);

  /* A valley along y between two slopes: from either, a tip in the wedge below projects onto the other. */
  start_network(&net);
  add_node(&net, 0.0, -0.01, 0.0, 1.0, false), add_node(&net, 0.0, 0.01, 0.0, 1.0, false);
  add_node(&net, 0.02, 0.0, 0.02, 1.0, false), add_node(&net, -0.02, 0.0, 0.02, 1.0, false);
  add_triangle(&net, 0, 2, 1);
  add_triangle(&net, 0, 1, 3);
  surface valley = {0};
  if (!surface_create(&valley, &net.body, 0.1)) abort();
  for (uint32_t from = 0; from < 2; from++) {
    at.triangle = from;
    const bool kept = surface_project(&valley, net.rest, (vec3){0.001, 0.003, -0.005}, &at);
    const double off = length(subtract(surface_position(&valley, net.rest, &at), (vec3){0.0, 0.003, 0.0}));
    at_most("a valley: the contact lies on the edge of the lower triangle, m",
            kept && at.triangle == 0 ? off : INFINITY, 1e-17);
  }
  at.triangle = 0;
  holds("over an open border the contact ends", !surface_project(&valley, net.rest, (vec3){0.02, 0.009, 0.01}, &at));
  surface_destroy(&valley);
}

/* Nonlinear forces on the free nodes of a network, nodes outside the patch at rest. */
static void network_forces(const network *net, const double *x, const double *v, double *f) {
  for (uint32_t i = 0; i < net->body.nodes; i++)
    set_row(f, i, subtract(scale(net->mass[i], vector(net->body.gravity)), scale(net->body.drag, row(v, i))));
  for (uint64_t s = 0; s < net->body.springs; s++) {
    const uint32_t i = net->spring_nodes[2 * s], j = net->spring_nodes[2 * s + 1];
    const vec3 d = subtract(row(x, j), row(x, i)), u = unit(d), w = subtract(row(v, j), row(v, i));
    const vec3 force =
        scale(net->stiffness[s] * (length(d) - net->rest_length[s]) + net->damping[s] * dot(w, u), u);
    set_row(f, i, add(row(f, i), force));
    set_row(f, j, subtract(row(f, j), force));
  }
}

/* K and D against central differences, in a deformed and moving state with gravity and drag. */
static void tangent(void) {
  static network net;
  make_block(&net);
  net.body.drag = 0.1;
  net.body.gravity[2] = -9.81;
  uint32_t seed = 1;
  for (uint32_t i = 0; i < 3 * net.body.nodes; i++) {
    if (net.fixed[i / 3]) continue;
    net.x[i] += 1e-3 * drawn(&seed);
    net.v[i] = 0.1 * drawn(&seed);
  }
  session s = start(&net, (vec3){0.0, 0.0, 0.1}, setup_for(STICKSLIP_LAW_STICKING, 0.0, 0.0, ""));
  local_model *model = ((renderer *)s.renderer)->model;
  static double v[3 * MOST_NODES], up[3 * MOST_NODES], down[3 * MOST_NODES];
  memset(v, 0, sizeof v);
  for (uint32_t p = 0; p < model->m; p++) set_row(v, model->node[p], row(net.v, model->node[p]));

  network_forces(&net, net.x, v, up);
  local_model_forces(model);
  double at_rest = 0.0, derivative = 0.0;
  for (uint32_t p = 0; p < model->m; p++)
    at_rest = fmax(at_rest, length(subtract(row(model->f, p), row(up, model->node[p]))));
  for (uint32_t q = 0; q < 3 * model->m; q++)
    for (int velocity = 0; velocity < 2; velocity++) {
      const double step = velocity ? 1e-4 : 1e-6;
      const uint32_t of_body = 3 * model->node[q / 3] + q % 3;
      double *in_body = velocity ? v + of_body : net.x + of_body;
      double *in_model = velocity ? model->v + q : model->x + of_body;
      const double value = *in_body, model_value = *in_model;
      *in_body = value + step;
      network_forces(&net, net.x, v, up);
      *in_body = value - step;
      network_forces(&net, net.x, v, down);
      *in_body = value;
      *in_model = model_value + step;
      local_model_forces(model);
      *in_model = model_value;
      for (uint32_t p = 0; p < model->m; p++) {
        const vec3 expected = scale(0.5 / step, subtract(row(up, model->node[p]), row(down, model->node[p])));
        const vec3 found = scale(1.0 / step, subtract(row(model->f, p), row(model->f_0, p)));
        derivative = fmax(derivative, length(subtract(found, expected)) / (velocity ? 0.5 : 100.0));
      }
    }
  end(&s);
  at_most("forces at the hand-over against the network's, N", at_rest, 1e-12);
  at_most("K and D against central differences, relative", derivative, 1e-5);
}

/* Press, drag and lift under each law. */
static void drags(void) {
  static const char *const name[3] = {"sliding", "sticking", "stick-slip"};
  static network net;
  static vec3 force[DRAG_TICKS], again[DRAG_TICKS];
  static int32_t mode[DRAG_TICKS];
  const double friction = 0.3;
  for (int32_t law = STICKSLIP_LAW_SLIDING; law <= STICKSLIP_LAW_STICK_SLIP; law++) {
    printf("      -- drag under %s\n", name[law]);
    const stickslip_setup setup = setup_for(law, friction, 0.0, "rings=2");
    make_block(&net);
    session s = start(&net, drag_path(0), setup);
    int slips = 0, sticks = 0, contacts = 0;
    double free_force = 0.0, pull = 0.0, beyond = 0.0, off_tip = 0.0, sideways = 0.0, early = 0.0, largest = 0.0;
    for (uint64_t i = 0; i < DRAG_TICKS; i++) {
      if (i > 0 && i % 100 == 0) hand_over(&s);
      const vec3 q = drag_path(i + 1), f = force[i] = tick(&s, q), n = vector(s.output.normal);
      const double normal = dot(f, n), along = length(subtract(f, scale(normal, n)));
      largest = fmax(largest, length(f));
      if (q.z > 1e-4 && i < 200) early = fmax(early, length(f));
      if (s.output.mode == STICKSLIP_MODE_FREE) {
        free_force = fmax(free_force, length(f));
        continue;
      }
      contacts++;
      pull = fmax(pull, -normal);
      if (law == STICKSLIP_LAW_SLIDING) sideways = fmax(sideways, along);
      if (law == STICKSLIP_LAW_STICK_SLIP) beyond = fmax(beyond, along - friction * normal);
      if (s.output.mode == STICKSLIP_MODE_STICK) {
        sticks++;
        off_tip = fmax(off_tip, length(subtract(contact_point(&s), q)));
      }
      if (s.output.mode == STICKSLIP_MODE_SLIP) slips++;
    }
    at_most("force in free ticks, N", free_force, 0.0);
    at_most("force before the first contact, N", early, 0.0);
    at_most("pull on the tip, N", pull, 0.0);
    at_most("allocations within ticks", (double)s.allocated, 0.0);
    at_most("force after the lift, N", length(force[DRAG_TICKS - 1]), 0.0);
    holds("the press pushes the tip out", force[299].z > 0.1);
    holds("contact lasts for most of the press and the drag", contacts > 600);
    at_most("largest force, N", largest, 20.0);
    if (law == STICKSLIP_LAW_SLIDING) at_most("tangential force of sliding, N", sideways, 1e-12);
    if (law == STICKSLIP_LAW_STICK_SLIP) at_most("tangential force beyond the cone, N", beyond, 1e-12);
    if (law == STICKSLIP_LAW_STICK_SLIP) holds("the drag both sticks and slips", slips > 50 && sticks > 50);
    if (law != STICKSLIP_LAW_SLIDING) at_most("sticking point off the tip, m", off_tip, 1e-15);
    end(&s);

    session second = drag(&net, setup, again, mode);
    end(&second);
    holds("a second run gives the same bits", memcmp(force, again, sizeof force) == 0);
  }
}

/* Adhesion that is infinite holds on through the lift. */
static void adhesion(void) {
  static network net;
  static vec3 force[DRAG_TICKS];
  static int32_t mode[DRAG_TICKS];
  session s = drag(&net, setup_for(STICKSLIP_LAW_STICKING, 0.0, INFINITY, "rings=all"), force, mode);
  int lost = 0;
  for (int i = 250; i < DRAG_TICKS; i++) lost += mode[i] != STICKSLIP_MODE_STICK;
  holds("infinite adhesion never lets go", lost == 0);
  holds("infinite adhesion pulls after the lift", force[DRAG_TICKS - 1].z < 0.0);
  end(&s);
}

/* A contact point outside the patch meets a wall of 1000 N/m, which leaves the model alone: with one ring, the patch is
 * one of three columns, and its share of the contact point is 1/3. */
static void wall(void) {
  static network net;
  make_columns(&net, 1, 0.02, 80.0, 0.5);
  session s = start(&net, (vec3){0.0, 0.0, 1e-3}, setup_for(STICKSLIP_LAW_STICKING, 0.0, 0.0, ""));
  double error = 0.0, moved = 0.0;
  for (int i = 1; i <= 30; i++) {
    const double z = 1e-3 * fabs(1.0 - 0.1 * i) - 5e-4;
    const vec3 force = tick(&s, (vec3){0.0, 0.0, z});
    error = fmax(error, length(subtract(force, (vec3){0.0, 0.0, fmax(0.0, -1000.0 * z)})));
    moved = fmax(moved, fabs(net.x[2]));
  }
  at_most("contact outside the patch: force against the wall's, N", error, 1e-12);
  at_most("contact outside the patch: motion of the patch, m", moved, 0.0);
  end(&s);
}

/* Two renderers in the same state, one of which takes over a second model that is built from the same state. */
static void same_hand_over(void) {
  static network one, two;
  make_block(&one);
  make_block(&two);
  const stickslip_setup setup = setup_for(STICKSLIP_LAW_STICK_SLIP, 0.3, 0.0, "");
  session a = start(&one, drag_path(0), setup), b = start(&two, drag_path(0), setup);
  static network at_rest;
  make_block(&at_rest);
  double difference = 0.0;
  for (uint64_t i = 0; i < 280; i++) {
    if (i % 40 == 39) {
      b.net = &at_rest; /* both models are built from the state at rest, about a free tip */
      const stickslip_output output = b.output;
      const vec3 tip = b.tip;
      b.output.mode = STICKSLIP_MODE_FREE;
      b.tip = drag_path(0);
      hand_over(&b);
      b.net = &two, b.output = output, b.tip = tip;
    }
    const vec3 f = tick(&a, drag_path(i + 1)), g = tick(&b, drag_path(i + 1));
    difference = fmax(difference, length(subtract(f, g)));
  }
  at_most("hand-over to a model of the same state: change of the force, N", difference, 1e-9);
  end(&a);
  end(&b);
}

static bool message_contains(void *renderer_, const char *part) {
  char text[256] = "";
  const uint64_t size = stickslip_renderer_message(renderer_, text, sizeof text - 1);
  return size == strlen(text) && strstr(text, part) != NULL;
}

static void refusals(void) {
  static network net;
  make_block(&net);
  struct {
    const char *what, *options, *message;
  } cases[] = {{"an unknown option is refused", "rings=1;colour=blue", "colour"},
               {"rings=0 is refused", "rings=0", "rings"},
               {"an option without a value is refused", "rings", "rings"},
#ifndef STICKSLIP_FAULTS
               {"the option fault is refused without STICKSLIP_FAULTS", "fault=lag", "fault"},
#endif
               {"an unknown fault is refused", "fault=none-such", "fault"}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    const stickslip_setup setup = setup_for(STICKSLIP_LAW_SLIDING, 0.0, 0.0, cases[i].options);
    void *refused = stickslip_renderer_create(&net.body, &setup);
    holds(cases[i].what, !refused && message_contains(NULL, cases[i].message));
  }
  stickslip_setup shaded = setup_for(STICKSLIP_LAW_SLIDING, 0.0, 0.0, "");
  shaded.surface = STICKSLIP_SURFACE_SHADED;
  holds("another surface is refused",
        !stickslip_renderer_create(&net.body, &shaded) && message_contains(NULL, "faceted"));
  shaded = setup_for(STICKSLIP_LAW_SLIDING, 0.0, 0.0, "");
  net.triangle_nodes[4] = 4000000000u;
  holds("a triangle without its node is refused",
        !stickslip_renderer_create(&net.body, &shaded) && message_contains(NULL, "triangle"));
}

static void faults_of_a_tick(void) {
  static network net;
  make_block(&net);
  session s = start(&net, drag_path(0), setup_for(STICKSLIP_LAW_STICKING, 0.0, 0.0, ""));
  for (uint64_t i = 0; i < 300; i++) tick(&s, drag_path(i + 1));
  const double good[3] = {s.tip.x, s.tip.y, s.tip.z};
  for (int k = 0; k < 3; k++) {
    double bad[3] = {good[0], good[1], good[2]};
    bad[k] = k == 2 ? INFINITY : NAN;
    stickslip_output output = {.size = sizeof output, .force = {9.0, 9.0, 9.0}};
    const int32_t fault = stickslip_renderer_tick(s.renderer, good, bad, &output);
    holds("a tip that is not finite is a fault without a force",
          fault != 0 && length(vector(output.force)) == 0.0 && message_contains(s.renderer, "tip"));
  }
  holds("after the fault the contact goes on", length(tick(&s, s.tip)) > 0.1);

  const uint64_t count = stickslip_renderer_moved(s.renderer, 0, NULL, NULL, NULL);
  uint32_t nodes[MOST_NODES];
  double x[3 * MOST_NODES], v[3 * MOST_NODES];
  nodes[0] = 77777;
  holds("above the capacity nothing is written",
        count > 1 && stickslip_renderer_moved(s.renderer, count - 1, nodes, x, v) == count && nodes[0] == 77777);
  end(&s);

  make_block(&net);
  s = start(&net, (vec3){0.001, 0.0013, 0.05}, setup_for(STICKSLIP_LAW_STICK_SLIP, 0.5, 0.0, ""));
  double largest = 0.0;
  for (int i = 0; i < 50; i++)
    largest = fmax(largest, length(tick(&s, (vec3){0.001, 0.0013, i % 10 < 5 ? 0.05 : -0.01})));
  at_most("largest force of a tip that jumps through the surface by 60 mm, N", largest, 100.0);
  end(&s);

  void *renderer_ = stickslip_renderer_create(&net.body, &(stickslip_setup){.size = sizeof(stickslip_setup),
                                                                           .tick_s = TICK,
                                                                           .options = ""});
  stickslip_output output = {.size = sizeof output};
  holds("a tick before the first model is a fault", stickslip_renderer_tick(renderer_, good, good, &output) != 0);
  for (uint32_t i = 0; i < net.body.nodes; i++) set_row(net.x, i, (vec3){0.0, 0.0, 0.0});
  const stickslip_state flat = {.size = sizeof flat, .x = net.x, .v = net.v, .tip = good};
  holds("a state with a spring of no length is refused",
        !stickslip_renderer_build(renderer_, &flat) && message_contains(renderer_, "length"));
  stickslip_renderer_destroy(renderer_);
}

#ifdef STICKSLIP_FAULTS
/* Every deliberate fault changes the forces of a drag, or allocates, by as much as this prints. */
static void seeded_faults(void) {
  static const char *const names[] = {"release-sign", "beyond-cone",     "energy-leak", "allocation",   "lag",
                                      "world-axes",   "nan-on-teleport", "drift",       "spring-order", "handover-jump"};
  static network net;
  static vec3 honest[DRAG_TICKS], force[DRAG_TICKS];
  session s = drag(&net, setup_for(STICKSLIP_LAW_STICK_SLIP, 0.3, 0.0, "rings=2"), honest, NULL);
  end(&s);
  for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
    char options[64];
    snprintf(options, sizeof options, "rings=2;fault=%s", names[i]);
    s = drag(&net, setup_for(STICKSLIP_LAW_STICK_SLIP, 0.3, 0.0, options), force, NULL);
    double largest = 0.0, pull = 0.0;
    for (int k = 0; k < DRAG_TICKS; k++) {
      largest = fmax(largest, length(subtract(force[k], honest[k])));
      pull = fmax(pull, -force[k].z);
    }
    bool shown = largest > 1e-4;
    if (strcmp(names[i], "allocation") == 0) shown = s.allocated == DRAG_TICKS && largest == 0.0;
    if (strcmp(names[i], "release-sign") == 0) shown = pull > 1e-3;
    if (strcmp(names[i], "nan-on-teleport") == 0)
      shown = largest == 0.0 && isnan(tick(&s, (vec3){0.0, 0.0, -0.004}).x);
    printf("      fault %-16s largest change %.3g N, largest pull %.3g N, allocations %llu\n", names[i], largest, pull,
           (unsigned long long)s.allocated);
    holds("the fault shows", shown);
    end(&s);
  }
}
#endif

int main(void) {
  holds("version of the interface", stickslip_renderer_abi() == STICKSLIP_RENDERER_ABI);
  two_free_masses();
  two_pressed_masses(false);
  two_pressed_masses(true);
  for (int32_t law = STICKSLIP_LAW_SLIDING; law <= STICKSLIP_LAW_STICK_SLIP; law++) moving_surface(law);
  surface_of_a_box();
  tangent();
  drags();
  adhesion();
  wall();
  same_hand_over();
  refusals();
  faults_of_a_tick();
#ifdef STICKSLIP_FAULTS
  seeded_faults();
#endif
  printf("%s: %d failures\n", failures ? "FAIL" : "pass", failures);
  return failures != 0;
}
