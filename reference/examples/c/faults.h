/*
 * Deliberate faults, with which a check of conformance is itself tested. They exist only in a library that is compiled
 * with -DSTICKSLIP_FAULTS; without it, every function below is empty.
 */
#ifndef PAPER_MODEL_FAULTS_H
#define PAPER_MODEL_FAULTS_H

#include "model.h"

#ifdef STICKSLIP_FAULTS

/* Takes the value of the option `fault`. Returns false where there is no such fault or no memory. */
bool fault_choose(renderer *r, const char *name, size_t length);
/* Follows the reading of options: changes the setup. */
void fault_after_create(renderer *r);
/* A spring that the local model leaves out, or NONE. */
uint32_t fault_spring_left_out(const renderer *r, const local_model *model);
void fault_after_swap(renderer *r, const local_model *old);
/* Changes the tip that the model sees. */
void fault_before_tick(renderer *r, vec3 *q0, vec3 *q1);
/* Changes the output of the tick. */
void fault_after_tick(renderer *r, vec3 q0, vec3 q1, stickslip_output *output);
void fault_destroy(renderer *r);

#else

static inline bool fault_choose(renderer *r, const char *name, size_t length) {
  (void)r, (void)name, (void)length;
  return false;
}
static inline void fault_after_create(renderer *r) { (void)r; }
static inline uint32_t fault_spring_left_out(const renderer *r, const local_model *model) {
  (void)r, (void)model;
  return NONE;
}
static inline void fault_after_swap(renderer *r, const local_model *old) { (void)r, (void)old; }
static inline void fault_before_tick(renderer *r, vec3 *q0, vec3 *q1) { (void)r, (void)q0, (void)q1; }
static inline void fault_after_tick(renderer *r, vec3 q0, vec3 q1, stickslip_output *output) {
  (void)r, (void)q0, (void)q1, (void)output;
}
static inline void fault_destroy(renderer *r) { (void)r; }

#endif
#endif
