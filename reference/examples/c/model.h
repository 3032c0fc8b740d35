/*
 * The local model of Jacobs & Çavuşoğlu, "High Fidelity Haptic Rendering of Stick-Slip Frictional Contact With
 * Deformable Objects in Virtual Environments Using Multi-Rate Simulation". A number in parentheses is an equation of
 * that paper.
 *
 * surface.c      the surface of the body: neighbours, projection, nearest point, collision in time
 * local_model.c  the patch and its linearisation (1)-(4)
 * contact.c      one tick: collision, deformation, contact laws (5), (11)-(28)
 * renderer.c     the functions of stickslip_renderer.h
 * faults.c       deliberate faults, only with -DSTICKSLIP_FAULTS
 *
 * Symbols: n nodes of the body, m nodes of the patch, h time of a tick (s), x positions (m), v velocities (m/s),
 * f node forces (N), K = df/dx (N/m), D = df/dv (N s/m), w weights of the contact point p = sum w_i x_i, n the outward
 * unit normal, q0 and q1 the tip at the start and the end of a tick. An array "m x 3" holds rows of three numbers.
 */
#ifndef PAPER_MODEL_H
#define PAPER_MODEL_H

#include <math.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "stickslip_renderer.h"

/* No node, no triangle, no place in the patch. */
#define NONE UINT32_MAX

/* ---- Vectors -------------------------------------------------------------------------------------------------- */

typedef struct vec3 {
  double x, y, z;
} vec3;

static inline vec3 vector(const double a[3]) { return (vec3){a[0], a[1], a[2]}; }
/* Row `i` of an array of vectors. */
static inline vec3 row(const double *array, uint32_t i) { return vector(array + 3 * (size_t)i); }
static inline void set_row(double *array, uint32_t i, vec3 a) {
  array[3 * (size_t)i] = a.x, array[3 * (size_t)i + 1] = a.y, array[3 * (size_t)i + 2] = a.z;
}
static inline vec3 add(vec3 a, vec3 b) { return (vec3){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline vec3 subtract(vec3 a, vec3 b) { return (vec3){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline vec3 scale(double s, vec3 a) { return (vec3){s * a.x, s * a.y, s * a.z}; }
static inline double dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline vec3 cross(vec3 a, vec3 b) {
  return (vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline double length(vec3 a) { return sqrt(dot(a, a)); }
static inline vec3 unit(vec3 a) { return scale(1.0 / length(a), a); }
static inline bool finite3(vec3 a) { return isfinite(a.x) && isfinite(a.y) && isfinite(a.z); }

/* ---- Surface (surface.c) -------------------------------------------------------------------------------------- */

/* Connectivity of the surface's triangles. It is constant but for the working memory. */
typedef struct surface {
  uint32_t triangles;
  const uint32_t *corner;     /* triangles x 3: nodes, counterclockwise seen from outside */
  uint32_t *neighbour;        /* triangles x 3: triangle across the edge opposite corner k, or NONE */
  uint32_t *incident_start;   /* n + 1: where the triangles of a node start in `incident` */
  uint32_t *incident;         /* triangles x 3: triangles of each node */
  uint64_t *visited;          /* triangles: working memory of a projection */
  uint64_t walk;              /* number of the last projection */
  double *measure;            /* triangles: working memory of a search */
  double margin;              /* m: the tip meets no triangle that is farther away than this */
} surface;

/* A point of the surface. */
typedef struct surface_point {
  uint32_t triangle;
  double weights[3]; /* barycentric */
} surface_point;

/* `size` is the extent of the body (m). Returns false where there is not enough memory. */
bool surface_create(surface *s, const stickslip_body *body, double size);
void surface_destroy(surface *s);
vec3 surface_position(const surface *s, const double *x, const surface_point *at);
vec3 surface_normal(const surface *s, const double *x, uint32_t triangle);
/* Moves a contact to the projection of q onto the surface at x, across edges where it must. Returns false where the
 * projection leaves the surface over an open border. */
bool surface_project(surface *s, const double *x, vec3 q, surface_point *at);
/* Finds the surface point nearest to q. Returns the signed distance (m), positive outside. */
double surface_nearest(surface *s, const double *x, vec3 q, surface_point *at);
/* Finds the first passage of the tip from outside to inside while the nodes move from x to x_end. Returns the share
 * of the tick before it, in [0, 1], or infinity. */
double surface_collision(surface *s, const double *x, const double *x_end, vec3 q0, vec3 q1, surface_point *at);

/* ---- Local model (local_model.c) ------------------------------------------------------------------------------ */

/* Stiffness and damping between two nodes of the patch. */
typedef struct block {
  uint32_t column; /* place in the patch */
  double K[9];     /* N/m, by rows */
  double D[9];     /* N s/m, by rows */
} block;

/* State of the contact between ticks. */
typedef enum contact_status {
  CONTACT_NONE,   /* the tip is outside */
  CONTACT_HELD,   /* the tip touches the surface at `at` */
  CONTACT_TENSION /* the tip would have to pull: no force, but the tip has not left the body */
} contact_status;

typedef struct contact {
  contact_status status;
  surface_point at;
  int32_t mode; /* of the last tick */
} contact;

/* The patch around the contact, linearised at a hand-over. Nodes outside the patch are a wall (section III). */
typedef struct local_model {
  uint32_t m;             /* nodes of the patch, all of them free */
  uint32_t *node;         /* m: their numbers in the body, ascending */
  uint32_t *place;        /* n: the place of a node in the patch, or NONE */
  double *x;              /* n x 3: positions; those outside the patch as at the hand-over, m */
  double *v;              /* m x 3: velocities, m/s */
  double *x_0, *v_0, *f_0; /* m x 3: state of the linearisation, and the forces there, (4) */
  double *inverse_mass;   /* m: 1/kg */
  uint32_t *row_start;    /* m + 1: where the row of a node starts in `blocks` */
  block *blocks;
  double *x_predicted;    /* n x 3: prediction (11) of x */
  double *v_predicted;    /* m x 3: prediction (11) of v */
  double *acceleration;   /* m x 3: of the prediction, m/s^2 */
  double *f;              /* m x 3: forces at the current state, N */
  double *offset;         /* m x 6: working memory, x - x_0 and v - v_0 of each node */
  contact initial;        /* the contact that the hand-over's state describes */
} local_model;

struct renderer;
local_model *local_model_build(const struct renderer *r, const stickslip_state *state, const char **reason);
void local_model_destroy(local_model *model);
/* Evaluates f = f_0 + K (x - x_0) + D (v - v_0), (3), at the model's x and v. */
void local_model_forces(local_model *model);

/* ---- Renderer (renderer.c, contact.c) ------------------------------------------------------------------------- */

/* Faults that a tick returns. */
enum {
  FAULT_TIP = 1,      /* a coordinate of the tip is not finite */
  FAULT_FORCE = 2,    /* the force is not finite */
  FAULT_DIVERGED = 3, /* a node is not finite or far from its rest position */
  FAULT_NO_MODEL = 4  /* a tick before the first swap */
};

/* Number of rings that takes every free node. */
#define RINGS_ALL UINT32_MAX

typedef struct renderer {
  stickslip_body body;   /* the caller's arrays */
  stickslip_setup setup; /* without `options` */
  uint32_t rings;        /* option: rings of nodes around the centre of the patch */
  int fault;             /* option: the deliberate fault, FAULT_SEED_... of faults.h */
  uint32_t *spring_start; /* n + 1: where the springs of a node start in `springs_of_node` */
  uint32_t *springs_of_node; /* springs x 2 */
  surface surface;
  double reach;          /* m: a node farther from its rest position has diverged */
  local_model *model;    /* the model in use */
  contact contact;
  struct fault_memory *fault_memory;
  _Atomic(const char *) message; /* a constant text */
} renderer;

int32_t contact_tick(renderer *r, vec3 q0, vec3 q1, stickslip_output *output);

#endif
