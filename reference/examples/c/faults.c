/* Deliberate faults; see faults.h. */
#include "faults.h"

#ifdef STICKSLIP_FAULTS

#include <stdlib.h>
#include <string.h>

enum {
  NO_FAULT,
  RELEASE_SIGN,    /* the force changes its sign when the contact is released or under tension: it pulls */
  BEYOND_CONE,     /* friction is 1.3 times too large */
  ENERGY_LEAK,     /* the force on retreat is 10 % above that on approach: a closed path gives energy */
  ALLOCATION,      /* every tick allocates and frees memory */
  LAG,             /* the output is that of the tick before */
  WORLD_AXES,      /* the x component of the force is 10 % too large, whatever way the body is turned */
  NAN_ON_TELEPORT, /* the force is not a number where the tip moves by more than 5 mm in a tick */
  DRIFT,           /* the contact point creeps by 0.1 um per tick */
  SPRING_ORDER,    /* the last spring of the list that touches the patch is left out */
  HANDOVER_JUMP,   /* the first tick after a change of models has a force 20 % too large */
  FAULT_COUNT
};

static const char *const NAMES[FAULT_COUNT] = {
    "none",       "release-sign",    "beyond-cone", "energy-leak",  "allocation",    "lag",
    "world-axes", "nan-on-teleport", "drift",       "spring-order", "handover-jump",
};

struct fault_memory {
  stickslip_output last;    /* output of the tick before, without the fault */
  stickslip_output contact; /* the last output in contact, without the fault */
  bool after_swap;          /* the next tick is the first after a change of models */
  vec3 creep;               /* m: how far the contact point has crept */
};

bool fault_choose(renderer *r, const char *name, size_t length) {
  if (!r->fault_memory) r->fault_memory = calloc(1, sizeof *r->fault_memory);
  for (int fault = NO_FAULT; r->fault_memory && fault < FAULT_COUNT; fault++)
    if (strlen(NAMES[fault]) == length && strncmp(NAMES[fault], name, length) == 0) {
      r->fault = fault;
      return true;
    }
  return false;
}

void fault_destroy(renderer *r) { free(r->fault_memory); }

void fault_after_create(renderer *r) {
  if (r->fault == BEYOND_CONE) r->setup.friction_static *= 1.3, r->setup.friction_kinetic *= 1.3;
}

uint32_t fault_spring_left_out(const renderer *r, const local_model *model) {
  if (r->fault != SPRING_ORDER) return NONE;
  for (uint32_t spring = (uint32_t)r->body.springs; spring-- > 0;) {
    const uint32_t *ends = r->body.spring_nodes + 2 * (size_t)spring;
    if (model->place[ends[0]] != NONE || model->place[ends[1]] != NONE) return spring;
  }
  return NONE;
}

void fault_after_swap(renderer *r, const local_model *old) {
  if (r->fault_memory) r->fault_memory->after_swap = old != NULL;
}

void fault_before_tick(renderer *r, vec3 *q0, vec3 *q1) {
  if (r->fault != DRIFT) return;
  vec3 *creep = &r->fault_memory->creep;
  if (r->contact.status == CONTACT_NONE) *creep = (vec3){0.0, 0.0, 0.0};
  *q0 = add(*q0, *creep);
  if (r->contact.status == CONTACT_HELD) {
    const uint32_t *corner = r->surface.corner + 3 * (size_t)r->contact.at.triangle;
    *creep = add(*creep, scale(1e-7, unit(subtract(row(r->model->x, corner[1]), row(r->model->x, corner[0])))));
  }
  *q1 = add(*q1, *creep);
}

void fault_after_tick(renderer *r, vec3 q0, vec3 q1, stickslip_output *output) {
  struct fault_memory *memory = r->fault_memory;
  if (!memory) return;
  const stickslip_output true_output = *output;
  const bool free_now = output->mode == STICKSLIP_MODE_FREE, free_before = memory->last.mode == STICKSLIP_MODE_FREE;
  const vec3 force = vector(output->force), motion = subtract(q1, q0);
  switch (r->fault) {
    case RELEASE_SIGN:
      if (free_now && (!free_before || r->contact.status == CONTACT_TENSION)) {
        *output = memory->contact;
        set_row(output->force, 0, scale(-1.0, vector(memory->contact.force)));
      }
      break;
    case ENERGY_LEAK:
      if (!free_now && dot(motion, vector(output->normal)) > 0.0) set_row(output->force, 0, scale(1.1, force));
      break;
    case ALLOCATION: {
      char *volatile memory_of_tick = malloc(64); /* volatile: the compiler may not remove it */
      if (memory_of_tick) memory_of_tick[0] = 1;
      free(memory_of_tick);
      break;
    }
    case LAG:
      *output = memory->last;
      output->size = true_output.size;
      break;
    case WORLD_AXES:
      output->force[0] *= 1.1;
      break;
    case NAN_ON_TELEPORT:
      if (length(motion) > 5e-3) output->force[0] = output->force[1] = output->force[2] = NAN;
      break;
    case HANDOVER_JUMP:
      if (memory->after_swap) set_row(output->force, 0, scale(1.2, force));
      break;
    default:
      break;
  }
  memory->last = true_output;
  if (!free_now) memory->contact = true_output;
  memory->after_swap = false;
}

#endif
