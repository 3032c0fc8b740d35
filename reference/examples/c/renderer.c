/* The functions of stickslip_renderer.h. */
#include "model.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "faults.h"

/* Why the last `create` of this thread was refused. */
static _Thread_local char refusal[256];

static const char *const FAULT_TEXT[] = {
    [FAULT_TIP] = "a coordinate of the tip is not finite",
    [FAULT_FORCE] = "the force is not finite",
    [FAULT_DIVERGED] = "the local model diverged: a node is not finite or far from its rest position",
    [FAULT_NO_MODEL] = "a tick was called before a model was swapped in",
};

uint32_t stickslip_renderer_abi(void) { return STICKSLIP_RENDERER_ABI; }

/* ---- Creation ------------------------------------------------------------------------------------------------- */

/* Text up to a length, for "%.*s". */
static int shown(size_t size) { return size > 60 ? 60 : (int)size; }

static bool read_option(renderer *r, const char *key, size_t key_size, const char *value, size_t value_size) {
  if (key_size == 5 && strncmp(key, "rings", 5) == 0) {
    if (value_size == 3 && strncmp(value, "all", 3) == 0) {
      r->rings = RINGS_ALL;
      return true;
    }
    uint32_t rings = 0;
    bool number = value_size > 0 && value_size <= 6;
    for (size_t i = 0; number && i < value_size; i++) {
      number = value[i] >= '0' && value[i] <= '9';
      if (number) rings = 10 * rings + (uint32_t)(value[i] - '0');
    }
    r->rings = rings;
    if (number && rings > 0) return true;
    snprintf(refusal, sizeof refusal, "option rings: `%.*s` is neither a whole number from 1 nor `all`",
             shown(value_size), value);
    return false;
  }
#ifdef STICKSLIP_FAULTS
  if (key_size == 5 && strncmp(key, "fault", 5) == 0) {
    if (fault_choose(r, value, value_size)) return true;
    snprintf(refusal, sizeof refusal, "option fault: there is no fault `%.*s`", shown(value_size), value);
    return false;
  }
#endif
  snprintf(refusal, sizeof refusal, "unknown option `%.*s`; the options are: rings", shown(key_size), key);
  return false;
}

/* Reads `key=value;key=value`. */
static bool read_options(renderer *r, const char *text) {
  while (text && *text) {
    const size_t size = strcspn(text, ";"), key_size = strcspn(text, "=;");
    if (size > 0 && key_size == size) {
      snprintf(refusal, sizeof refusal, "option `%.*s` has no value; write key=value;key=value", shown(size), text);
      return false;
    }
    if (size > 0 && !read_option(r, text, key_size, text + key_size + 1, size - key_size - 1)) return false;
    text += size;
    if (*text == ';') text++;
  }
  return true;
}

/* Returns what is wrong with the body or the setup; NULL if nothing is. */
static const char *objection(const stickslip_body *body, const stickslip_setup *setup) {
  if (body->nodes == 0 || body->nodes >= UINT32_MAX / 4) return "the number of nodes is out of range";
  if (body->springs >= UINT32_MAX / 4) return "the number of springs is out of range";
  if (body->triangles == 0 || body->triangles >= UINT32_MAX / 4) return "the number of triangles is out of range";
  for (uint64_t i = 0; i < body->nodes; i++) {
    if (!finite3(row(body->rest, (uint32_t)i))) return "a rest position is not finite";
    if (!body->fixed[i] && !(isfinite(body->mass[i]) && body->mass[i] > 0.0)) return "a free node has no mass";
  }
  for (uint64_t i = 0; i < body->springs; i++) {
    const uint32_t *ends = body->spring_nodes + 2 * i;
    if (ends[0] >= body->nodes || ends[1] >= body->nodes || ends[0] == ends[1])
      return "a spring does not join two nodes of the body";
    if (!isfinite(body->stiffness[i]) || !isfinite(body->damping[i]) || !isfinite(body->rest_length[i]))
      return "a spring's stiffness, damping or rest length is not finite";
  }
  for (uint64_t i = 0; i < body->triangles; i++) {
    const uint32_t *corner = body->triangle_nodes + 3 * i;
    if (corner[0] >= body->nodes || corner[1] >= body->nodes || corner[2] >= body->nodes ||
        corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0])
      return "a triangle does not join three nodes of the body";
  }
  if (!finite3(vector(body->gravity)) || !isfinite(body->drag)) return "gravity or drag is not finite";
  if (!isfinite(setup->tick_s) || !(setup->tick_s > 0.0)) return "the time of a tick is not positive";
  if (setup->law < STICKSLIP_LAW_SLIDING || setup->law > STICKSLIP_LAW_STICK_SLIP) return "the law is unknown";
  if (setup->surface != STICKSLIP_SURFACE_FACETED) return "this renderer knows the faceted surface alone";
  if (setup->radius != 0.0) return "this renderer knows a contact at a point alone: radius must be 0";
  if (!(setup->adhesion >= 0.0)) return "adhesion is negative";
  if (isinf(setup->adhesion) && setup->law != STICKSLIP_LAW_STICKING)
    return "infinite adhesion needs the law of sticking";
  if (setup->law == STICKSLIP_LAW_STICK_SLIP &&
      !(setup->friction_kinetic >= 0.0 && setup->friction_static >= setup->friction_kinetic &&
        isfinite(setup->friction_static)))
    return "friction must be 0 or more, and the static coefficient at least the kinetic one";
  return NULL;
}

/* Lists the springs of every node. */
static bool list_springs(renderer *r) {
  const uint64_t n = r->body.nodes, ends = 2 * r->body.springs;
  r->spring_start = calloc(n + 2, sizeof *r->spring_start);
  r->springs_of_node = malloc((ends + 1) * sizeof *r->springs_of_node);
  if (!r->spring_start || !r->springs_of_node) return false;
  /* Counts are shifted by two places, so that filling the list leaves the starts behind. */
  for (uint64_t e = 0; e < ends; e++) r->spring_start[r->body.spring_nodes[e] + 2]++;
  for (uint64_t i = 2; i < n + 2; i++) r->spring_start[i] += r->spring_start[i - 1];
  for (uint64_t e = 0; e < ends; e++)
    r->springs_of_node[r->spring_start[r->body.spring_nodes[e] + 1]++] = (uint32_t)(e / 2);
  return true;
}

/* Ten diagonals of the box around the body at rest. */
static double reach_of(const stickslip_body *body) {
  vec3 low = row(body->rest, 0), high = low;
  for (uint64_t i = 1; i < body->nodes; i++) {
    const vec3 x = row(body->rest, (uint32_t)i);
    low = (vec3){fmin(low.x, x.x), fmin(low.y, x.y), fmin(low.z, x.z)};
    high = (vec3){fmax(high.x, x.x), fmax(high.y, x.y), fmax(high.z, x.z)};
  }
  return 10.0 * length(subtract(high, low));
}

void *stickslip_renderer_create(const stickslip_body *body, const stickslip_setup *setup) {
  if (!body || !setup || body->size < sizeof *body || setup->size < sizeof *setup) {
    snprintf(refusal, sizeof refusal, "body or setup is of another version of the interface");
    return NULL;
  }
  const char *wrong = objection(body, setup);
  if (wrong) {
    snprintf(refusal, sizeof refusal, "%s", wrong);
    return NULL;
  }
  renderer *r = calloc(1, sizeof *r);
  snprintf(refusal, sizeof refusal, "there is not enough memory");
  if (!r) return NULL;
  r->body = *body;
  r->setup = *setup;
  r->setup.options = NULL;
  r->rings = 1;
  r->reach = reach_of(body);
  atomic_init(&r->message, "");
  if (!surface_create(&r->surface, body, r->reach) || !list_springs(r) || !read_options(r, setup->options)) {
    stickslip_renderer_destroy(r);
    return NULL;
  }
  fault_after_create(r);
  refusal[0] = '\0';
  return r;
}

void stickslip_renderer_destroy(void *renderer_) {
  renderer *r = renderer_;
  if (!r) return;
  local_model_destroy(r->model);
  surface_destroy(&r->surface);
  free(r->spring_start);
  free(r->springs_of_node);
  fault_destroy(r);
  free(r);
}

/* ---- Hand-over ------------------------------------------------------------------------------------------------ */

void *stickslip_renderer_build(void *renderer_, const stickslip_state *state) {
  renderer *r = renderer_;
  const char *reason = "the state is of another version of the interface";
  local_model *model = state->size < sizeof *state ? NULL : local_model_build(r, state, &reason);
  if (!model) atomic_store(&r->message, reason);
  return model;
}

/* Nodes of both patches go on from their positions and velocities; nodes that enter the patch start at the new
 * model's. The contact goes on as it is. */
void *stickslip_renderer_swap(void *renderer_, void *model_) {
  renderer *r = renderer_;
  local_model *model = model_, *old = r->model;
  if (old) {
    for (uint32_t p = 0; p < model->m; p++) {
      const uint32_t node = model->node[p], place = old->place[node];
      if (place == NONE) continue;
      set_row(model->x, node, row(old->x, node));
      set_row(model->v, p, row(old->v, place));
    }
  } else {
    r->contact = model->initial;
  }
  r->model = model;
  fault_after_swap(r, old);
  return old;
}

void stickslip_renderer_dispose(void *model) { local_model_destroy(model); }

/* ---- Tick ----------------------------------------------------------------------------------------------------- */

static bool diverged(const renderer *r) {
  const local_model *model = r->model;
  for (uint32_t p = 0; p < model->m; p++) {
    const uint32_t node = model->node[p];
    if (!(length(subtract(row(model->x, node), row(r->body.rest, node))) <= r->reach)) return true;
    if (!finite3(row(model->v, p))) return true;
  }
  return false;
}

/* Ends the decay of a body at rest before its numbers become subnormal, which slows arithmetic a hundredfold. */
static void stop_decay(local_model *model) {
  for (size_t i = 0; i < 3 * (size_t)model->m; i++)
    if (fabs(model->v[i]) < 1e-150) model->v[i] = 0.0;
}

static void clear(stickslip_output *output) {
  for (int k = 0; k < 3; k++) output->force[k] = output->weights[k] = output->normal[k] = 0.0;
  output->mode = STICKSLIP_MODE_FREE;
  output->triangle = 0;
}

int32_t stickslip_renderer_tick(void *renderer_, const double before[3], const double tip[3],
                                stickslip_output *output) {
  renderer *r = renderer_;
  vec3 q0 = vector(before), q1 = vector(tip);
  clear(output);
  int32_t fault = 0;
  if (!r->model) fault = FAULT_NO_MODEL;
  else if (!finite3(q0) || !finite3(q1)) fault = FAULT_TIP;
  if (!fault) {
    fault_before_tick(r, &q0, &q1);
    fault = contact_tick(r, q0, q1, output);
    if (!fault && diverged(r)) fault = FAULT_DIVERGED;
    stop_decay(r->model);
  }
  if (fault) {
    clear(output);
    atomic_store(&r->message, FAULT_TEXT[fault]);
    return fault;
  }
  fault_after_tick(r, q0, q1, output);
  return 0;
}

uint64_t stickslip_renderer_moved(void *renderer_, uint64_t capacity, uint32_t *nodes, double *x, double *v) {
  const local_model *model = ((renderer *)renderer_)->model;
  if (!model) return 0;
  if (model->m > capacity) return model->m;
  for (uint32_t p = 0; p < model->m; p++) {
    nodes[p] = model->node[p];
    set_row(x, p, row(model->x, model->node[p]));
    set_row(v, p, row(model->v, p));
  }
  return model->m;
}

uint64_t stickslip_renderer_message(void *renderer_, char *buffer, uint64_t capacity) {
  const char *text = renderer_ ? atomic_load(&((renderer *)renderer_)->message) : refusal;
  const uint64_t size = strlen(text);
  if (buffer && capacity > 0) memcpy(buffer, text, size < capacity ? size : capacity);
  return size;
}
