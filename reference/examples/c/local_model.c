/* The local model of section III: the nodes near the contact, linearised (3), (4); every other node is a wall. */
#include "model.h"

#include <stdlib.h>
#include <string.h>

#include "faults.h"

/* The surface node nearest to the contact point, or to the tip where there is no contact; a fixed node is passed over,
 * and the lowest number wins a tie. */
static uint32_t patch_centre(const renderer *r, const stickslip_state *state, const contact *touching) {
  const vec3 target = touching->status == CONTACT_HELD ? surface_position(&r->surface, state->x, &touching->at)
                                                       : vector(state->tip);
  uint32_t centre = NONE;
  double least = INFINITY;
  for (uint32_t i = 0; i < r->body.nodes; i++) {
    const bool on_surface = r->surface.incident_start[i + 1] > r->surface.incident_start[i];
    if (!on_surface || r->body.fixed[i]) continue;
    const vec3 away = subtract(row(state->x, i), target);
    if (dot(away, away) < least) least = dot(away, away), centre = i;
  }
  return centre;
}

/* Marks the nodes within `rings` springs of the centre. The path may lead through fixed nodes. */
static bool mark_rings(const renderer *r, uint32_t centre, uint8_t *marked) {
  uint32_t *queue = malloc((r->body.nodes + 1) * sizeof *queue);
  if (!queue) return false;
  uint64_t head = 0, tail = 0;
  queue[tail++] = centre;
  marked[centre] = 1;
  for (uint32_t ring = 0; ring < r->rings && head < tail; ring++) {
    for (const uint64_t end = tail; head < end; head++) {
      const uint32_t node = queue[head];
      for (uint32_t e = r->spring_start[node]; e < r->spring_start[node + 1]; e++) {
        const uint32_t *ends = r->body.spring_nodes + 2 * (size_t)r->springs_of_node[e];
        const uint32_t other = ends[0] == node ? ends[1] : ends[0];
        if (!marked[other]) marked[other] = 1, queue[tail++] = other;
      }
    }
  }
  free(queue);
  return true;
}

static void add_block(local_model *model, uint32_t place, uint32_t column, double sign, const double J[9],
                      const double B[9]) {
  uint32_t e = model->row_start[place];
  while (model->blocks[e].column != column) e++;
  for (int k = 0; k < 9; k++) {
    model->blocks[e].K[k] += sign * J[k];
    model->blocks[e].D[k] += sign * B[k];
  }
}

/* Adds a spring with its damper: f_i = [k (l - L) + c (w.u)] u, f_j = -f_i, with d = x_j - x_i, l = |d|, u = d/l and
 * w = v_j - v_i. Its derivatives, with S = I - uu', are
 *   df_i/dd = k [uu' + (1 - L/l) S] + c [u (S w)' + (w.u) S] / l,   df_i/dw = c uu'. */
static bool add_spring(const renderer *r, local_model *model, uint32_t spring) {
  const uint32_t i = r->body.spring_nodes[2 * (size_t)spring], j = r->body.spring_nodes[2 * (size_t)spring + 1];
  const uint32_t place_i = model->place[i], place_j = model->place[j];
  const double k = r->body.stiffness[spring], c = r->body.damping[spring], L = r->body.rest_length[spring];
  const vec3 still = {0.0, 0.0, 0.0};
  const vec3 v_i = place_i == NONE ? still : row(model->v_0, place_i);
  const vec3 v_j = place_j == NONE ? still : row(model->v_0, place_j);
  const vec3 d = subtract(row(model->x, j), row(model->x, i)), w = subtract(v_j, v_i);
  const double l = length(d);
  if (!(l > 0.0)) return false;
  const vec3 u = scale(1.0 / l, d);
  const double rate = dot(w, u);
  const vec3 Sw = subtract(w, scale(rate, u));

  const double direction[3] = {u.x, u.y, u.z}, sideways[3] = {Sw.x, Sw.y, Sw.z};
  double J[9], B[9];
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      const double uu = direction[a] * direction[b], S = (a == b ? 1.0 : 0.0) - uu;
      J[3 * a + b] = k * (uu + (1.0 - L / l) * S) + c * (direction[a] * sideways[b] + rate * S) / l;
      B[3 * a + b] = c * uu;
    }

  const vec3 f = scale(k * (l - L) + c * rate, u);
  if (place_i != NONE) {
    set_row(model->f_0, place_i, add(row(model->f_0, place_i), f));
    add_block(model, place_i, place_i, -1.0, J, B);
    if (place_j != NONE) add_block(model, place_i, place_j, 1.0, J, B);
  }
  if (place_j != NONE) {
    set_row(model->f_0, place_j, subtract(row(model->f_0, place_j), f));
    add_block(model, place_j, place_j, -1.0, J, B);
    if (place_i != NONE) add_block(model, place_j, place_i, 1.0, J, B);
  }
  return true;
}

/* Lays out the rows of K and D: a node of the patch, then those of its neighbours that are in the patch. */
static bool lay_out_rows(const renderer *r, local_model *model) {
  size_t most = model->m;
  for (uint32_t p = 0; p < model->m; p++)
    most += r->spring_start[model->node[p] + 1] - r->spring_start[model->node[p]];
  model->row_start = malloc((model->m + 1) * sizeof *model->row_start);
  model->blocks = calloc(most, sizeof *model->blocks);
  if (!model->row_start || !model->blocks) return false;
  uint32_t count = 0;
  for (uint32_t p = 0; p < model->m; p++) {
    const uint32_t node = model->node[p], start = count;
    model->row_start[p] = start;
    model->blocks[count++].column = p;
    for (uint32_t e = r->spring_start[node]; e < r->spring_start[node + 1]; e++) {
      const uint32_t *ends = r->body.spring_nodes + 2 * (size_t)r->springs_of_node[e];
      const uint32_t column = model->place[ends[0] == node ? ends[1] : ends[0]];
      uint32_t known = start;
      while (known < count && model->blocks[known].column != column) known++;
      if (column != NONE && known == count) model->blocks[count++].column = column;
    }
  }
  model->row_start[model->m] = count;
  return true;
}

static bool linearise(const renderer *r, local_model *model) {
  const double drag = r->body.drag;
  const double none[9] = {0.0}, identity_drag[9] = {drag, 0.0, 0.0, 0.0, drag, 0.0, 0.0, 0.0, drag};
  for (uint32_t p = 0; p < model->m; p++) {
    const double mass = r->body.mass[model->node[p]];
    model->inverse_mass[p] = 1.0 / mass;
    const vec3 weight = scale(mass, vector(r->body.gravity));
    set_row(model->f_0, p, subtract(weight, scale(drag, row(model->v_0, p))));
    add_block(model, p, p, -1.0, none, identity_drag);
  }
  const uint32_t left_out = fault_spring_left_out(r, model);
  for (uint32_t spring = 0; spring < r->body.springs; spring++) {
    const uint32_t *ends = r->body.spring_nodes + 2 * (size_t)spring;
    if (model->place[ends[0]] == NONE && model->place[ends[1]] == NONE) continue;
    if (spring != left_out && !add_spring(r, model, spring)) return false;
  }
  return true;
}

local_model *local_model_build(const renderer *r, const stickslip_state *state, const char **reason) {
  const size_t n = r->body.nodes;
  local_model *model = calloc(1, sizeof *model);
  uint8_t *marked = calloc(n + 1, 1);
  *reason = "there is not enough memory for a local model";
  if (!model || !marked) goto failed;

  model->initial.mode = state->mode;
  if (state->mode != STICKSLIP_MODE_FREE) {
    *reason = "the state names a contact triangle that the body does not have";
    if (state->triangle >= r->body.triangles) goto failed;
    model->initial.status = CONTACT_HELD;
    model->initial.at.triangle = state->triangle;
    memcpy(model->initial.at.weights, state->weights, sizeof state->weights);
  }
  const uint32_t centre = patch_centre(r, state, &model->initial);
  *reason = "the surface has no free node, or the state is not finite";
  if (centre == NONE) goto failed;

  *reason = "there is not enough memory for a local model";
  if (r->rings == RINGS_ALL) memset(marked, 1, n);
  else if (!mark_rings(r, centre, marked)) goto failed;
  if (model->initial.status == CONTACT_HELD)
    for (int k = 0; k < 3; k++) marked[r->surface.corner[3 * (size_t)state->triangle + k]] = 1;

  model->place = malloc((n + 1) * sizeof *model->place);
  model->node = malloc((n + 1) * sizeof *model->node);
  if (!model->place || !model->node) goto failed;
  for (uint32_t i = 0; i < n; i++) {
    const bool inside = marked[i] && !r->body.fixed[i];
    model->place[i] = inside ? model->m : NONE;
    if (inside) model->node[model->m++] = i;
  }

  const size_t m = model->m, vectors = 3 * m * sizeof(double);
  model->x = malloc(3 * n * sizeof(double));
  model->x_predicted = malloc(3 * n * sizeof(double));
  model->v = malloc(vectors), model->x_0 = malloc(vectors), model->v_0 = malloc(vectors);
  model->f_0 = malloc(vectors), model->f = malloc(vectors), model->v_predicted = malloc(vectors);
  model->acceleration = malloc(vectors), model->offset = malloc(2 * vectors);
  model->inverse_mass = malloc(m * sizeof(double));
  if (!model->x || !model->x_predicted || !model->v || !model->x_0 || !model->v_0 || !model->f_0 || !model->f ||
      !model->v_predicted || !model->acceleration || !model->offset || !model->inverse_mass ||
      !lay_out_rows(r, model))
    goto failed;

  memcpy(model->x, state->x, 3 * n * sizeof(double));
  memcpy(model->x_predicted, state->x, 3 * n * sizeof(double));
  for (uint32_t p = 0; p < m; p++) {
    set_row(model->x_0, p, row(state->x, model->node[p]));
    set_row(model->v_0, p, row(state->v, model->node[p]));
  }
  memcpy(model->v, model->v_0, vectors);
  *reason = "a spring has no length";
  if (!linearise(r, model)) goto failed;
  free(marked);
  return model;

failed:
  free(marked);
  local_model_destroy(model);
  return NULL;
}

void local_model_destroy(local_model *model) {
  if (!model) return;
  free(model->node), free(model->place), free(model->x), free(model->v), free(model->x_0), free(model->v_0);
  free(model->f_0), free(model->inverse_mass), free(model->row_start), free(model->blocks);
  free(model->x_predicted), free(model->v_predicted), free(model->acceleration), free(model->f);
  free(model->offset), free(model);
}

void local_model_forces(local_model *model) {
  for (uint32_t p = 0; p < model->m; p++)
    for (int k = 0; k < 3; k++) {
      model->offset[6 * (size_t)p + k] = model->x[3 * (size_t)model->node[p] + k] - model->x_0[3 * (size_t)p + k];
      model->offset[6 * (size_t)p + 3 + k] = model->v[3 * (size_t)p + k] - model->v_0[3 * (size_t)p + k];
    }
  for (uint32_t p = 0; p < model->m; p++) {
    double f[3] = {model->f_0[3 * (size_t)p], model->f_0[3 * (size_t)p + 1], model->f_0[3 * (size_t)p + 2]};
    for (uint32_t e = model->row_start[p]; e < model->row_start[p + 1]; e++) {
      const block *b = &model->blocks[e];
      const double *x = model->offset + 6 * (size_t)b->column, *v = x + 3;
      for (int k = 0; k < 3; k++)
        f[k] += b->K[3 * k] * x[0] + b->K[3 * k + 1] * x[1] + b->K[3 * k + 2] * x[2] + b->D[3 * k] * v[0] +
                b->D[3 * k + 1] * v[1] + b->D[3 * k + 2] * v[2];
    }
    memcpy(model->f + 3 * (size_t)p, f, sizeof f);
  }
}
