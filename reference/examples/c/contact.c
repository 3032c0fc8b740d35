/*
 * One tick of the hybrid method of sections IV and V. `contact_tick` at the end of the file gives the order:
 * predict, detect, deform, evaluate the force, apply the law, integrate.
 */
#include "model.h"

#include <string.h>

/* Below this weight on nodes of the patch, the contact point has left the patch. */
static const double PATCH_WEIGHT = 0.5;
/* N/m: the wall that stands for a contact point outside the patch. */
static const double WALL_STIFFNESS = 1000.0;

/* The contact of one tick: the operator W = [w_1 I, w_2 I, w_3 I, 0 ...] of (7)-(9) on nodes of the patch. */
typedef struct constraint {
  int count;
  uint32_t place[3]; /* places in the patch */
  double w[3];
  double sum, square; /* sum of w, sum of w^2 */
  vec3 n;
} constraint;

static constraint constrain(const renderer *r) {
  const local_model *model = r->model;
  const surface_point *at = &r->contact.at;
  constraint c = {.n = surface_normal(&r->surface, model->x, at->triangle)};
  for (int k = 0; k < 3; k++) {
    const uint32_t place = model->place[r->surface.corner[3 * (size_t)at->triangle + k]];
    if (place == NONE) continue;
    c.place[c.count] = place;
    c.w[c.count++] = at->weights[k];
    c.sum += at->weights[k];
    c.square += at->weights[k] * at->weights[k];
  }
  return c;
}

/* W y for an array of m x 3. */
static vec3 gather(const constraint *c, const double *y) {
  vec3 sum = {0.0, 0.0, 0.0};
  for (int k = 0; k < c->count; k++) sum = add(sum, scale(c->w[k], row(y, c->place[k])));
  return sum;
}

/* y <- y + W' a. */
static void scatter(const constraint *c, vec3 a, double *y) {
  for (int k = 0; k < c->count; k++) set_row(y, c->place[k], add(row(y, c->place[k]), scale(c->w[k], a)));
}

/* y <- P y, P = I - W'W / sum w^2: the closed form of (10). It stops the contact point. */
static void project_sticking(const constraint *c, double *y) {
  scatter(c, scale(-1.0 / c->square, gather(c, y)), y);
}

/* y <- Q y, Q = I - (W'n)(W'n)' / sum w^2: the closed form of (19). It stops the contact point along the normal. */
static void project_sliding(const constraint *c, double *y) {
  scatter(c, scale(-dot(c->n, gather(c, y)) / c->square, c->n), y);
}

/* ---- Steps ---------------------------------------------------------------------------------------------------- */

/* Moves each node of the contact by d / sum w, so that the contact point moves by d. */
static void deform(local_model *model, const constraint *c, vec3 d) {
  for (int k = 0; k < c->count; k++) {
    const uint32_t node = model->node[c->place[k]];
    set_row(model->x, node, add(row(model->x, node), scale(1.0 / c->sum, d)));
  }
}

/* v <- v + h a, with the acceleration of the current forces. */
static void accelerate(local_model *model, double h) {
  for (uint32_t p = 0; p < model->m; p++)
    set_row(model->v, p, add(row(model->v, p), scale(h * model->inverse_mass[p], row(model->f, p))));
}

static void move(local_model *model, double h) {
  for (uint32_t p = 0; p < model->m; p++) {
    const uint32_t node = model->node[p];
    set_row(model->x, node, add(row(model->x, node), scale(h, row(model->v, p))));
  }
}

/* (11): the state after the tick without a contact. */
static void predict(local_model *model, double h) {
  local_model_forces(model);
  for (uint32_t p = 0; p < model->m; p++) {
    const uint32_t node = model->node[p];
    const vec3 a = scale(model->inverse_mass[p], row(model->f, p));
    const vec3 v = add(row(model->v, p), scale(h, a));
    set_row(model->acceleration, p, a);
    set_row(model->v_predicted, p, v);
    set_row(model->x_predicted, node, add(row(model->x, node), scale(h, v)));
  }
}

/* Moves the state to the time of collision, a time t after the start of the tick. */
static void rewind_to(local_model *model, double t) {
  for (uint32_t p = 0; p < model->m; p++) {
    const uint32_t node = model->node[p];
    set_row(model->x, node, add(row(model->x, node), scale(t, row(model->v_predicted, p))));
    set_row(model->v, p, add(row(model->v, p), scale(t, row(model->acceleration, p))));
  }
}

/* Ends the tick without a force: the whole prediction is accepted. */
static void accept_prediction(renderer *r, contact_status status, stickslip_output *output) {
  local_model *model = r->model;
  for (uint32_t p = 0; p < model->m; p++) set_row(model->x, model->node[p], row(model->x_predicted, model->node[p]));
  memcpy(model->v, model->v_predicted, 3 * (size_t)model->m * sizeof(double));
  r->contact.status = status;
  r->contact.mode = output->mode = STICKSLIP_MODE_FREE;
}

static void report(renderer *r, const constraint *c, vec3 force, int32_t mode, stickslip_output *output) {
  set_row(output->force, 0, force);
  output->mode = mode;
  output->triangle = r->contact.at.triangle;
  memcpy(output->weights, r->contact.at.weights, sizeof output->weights);
  set_row(output->normal, 0, c->n);
  r->contact.status = CONTACT_HELD;
  r->contact.mode = mode;
}

/* Finds the contact of this tick at the model's x. Returns false where there is none. `h` becomes the part of the tick
 * after a collision. */
static bool detect(renderer *r, vec3 q0, vec3 q1, double *h) {
  local_model *model = r->model;
  contact *held = &r->contact;
  switch (held->status) {
    case CONTACT_NONE: {
      const double share = surface_collision(&r->surface, model->x, model->x_predicted, q0, q1, &held->at);
      if (share == INFINITY) return false;
      rewind_to(model, share * *h);
      *h *= 1.0 - share;
      return true;
    }
    case CONTACT_TENSION: {
      if (surface_nearest(&r->surface, model->x_predicted, q1, &held->at) > 0.0) return false;
      surface_nearest(&r->surface, model->x, q0, &held->at);
      return true;
    }
    case CONTACT_HELD:
      /* While the contact sticks it keeps its point. While it slid, the surface has moved under a tip that stood at
       * q0. Without friction, the point follows the tip to q1. */
      if (held->mode == STICKSLIP_MODE_STICK) return true;
      return surface_project(&r->surface, model->x, held->mode == STICKSLIP_MODE_SLIP ? q0 : q1, &held->at);
  }
  return false;
}

/* A contact point outside the patch: a rigid wall, which does not move the model. */
static int32_t touch_wall(renderer *r, const constraint *c, vec3 q1, stickslip_output *output) {
  surface_point nearest;
  const bool outside = surface_nearest(&r->surface, r->model->x_predicted, q1, &nearest) > 0.0;
  const vec3 p = surface_position(&r->surface, r->model->x, &r->contact.at);
  accept_prediction(r, CONTACT_NONE, output);
  if (outside) return 0;
  const double depth = dot(subtract(p, q1), c->n);
  const double force = WALL_STIFFNESS * depth;
  if (!isfinite(force)) return FAULT_FORCE;
  report(r, c, scale(force > 0.0 ? force : 0.0, c->n), STICKSLIP_MODE_SLIDE, output);
  return 0;
}

/* ---- The tick ------------------------------------------------------------------------------------------------- */

int32_t contact_tick(renderer *r, vec3 q0, vec3 q1, stickslip_output *output) {
  local_model *model = r->model;
  const int32_t law = r->setup.law;
  const bool slipped = r->contact.status == CONTACT_HELD && r->contact.mode == STICKSLIP_MODE_SLIP;
  double h = r->setup.tick_s;

  predict(model, h);
  if (!detect(r, q0, q1, &h)) {
    accept_prediction(r, CONTACT_NONE, output);
    return 0;
  }
  const constraint c = constrain(r);
  if (c.sum < PATCH_WEIGHT) return touch_wall(r, &c, q1, output);

  /* The surface is pushed to the tip, under sliding along the normal alone. */
  vec3 d = subtract(q1, surface_position(&r->surface, model->x, &r->contact.at));
  if (law == STICKSLIP_LAW_SLIDING) d = scale(dot(d, c.n), c.n);
  deform(model, &c, d);

  /* The force that holds the contact point, (14), (22), (27), here as the multiplier of the constraint:
   * l = W f / sum w^2. Where every corner of the triangle belongs to the patch it is the paper's sum of forces. */
  local_model_forces(model);
  const vec3 l = scale(1.0 / c.square, gather(&c, model->f));
  if (!finite3(l)) return FAULT_FORCE;
  const double F_N = dot(l, c.n);
  const vec3 tangential = subtract(l, scale(F_N, c.n));
  const double F_T = length(tangential);
  if (F_N <= -r->setup.adhesion) {
    accept_prediction(r, CONTACT_TENSION, output);
    return 0;
  }

  if (law == STICKSLIP_LAW_SLIDING) {
    accelerate(model, h);
    project_sliding(&c, model->v); /* (20) */
    report(r, &c, scale(F_N, c.n), STICKSLIP_MODE_SLIDE, output);
  } else {
    const double bearing = F_N + r->setup.adhesion;
    const double bound = (slipped ? r->setup.friction_kinetic : r->setup.friction_static) * bearing; /* (5) */
    if (law == STICKSLIP_LAW_STICKING || F_T <= bound) {
      accelerate(model, h);
      project_sticking(&c, model->v); /* (12) */
      report(r, &c, l, STICKSLIP_MODE_STICK, output);
    } else {
      /* (24), (28): the normal force, and friction along the tangential force. (25): W' f reaches the nodes. */
      const vec3 force =
          add(scale(F_N, c.n), scale(r->setup.friction_kinetic * bearing / F_T, tangential));
      scatter(&c, scale(-1.0, force), model->f);
      accelerate(model, h);
      project_sliding(&c, model->v); /* (26) */
      report(r, &c, force, STICKSLIP_MODE_SLIP, output);
    }
  }
  move(model, h);
  return 0;
}
