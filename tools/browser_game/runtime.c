// What kernels need besides their own code: Numba's counted memory, and Chipmunk by plain numbers.
#include <chipmunk/chipmunk_private.h>
#include <chipmunk/chipmunk_unsafe.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

// Numba's record of counted memory, with the offsets of a machine with 64-bit addresses, as in the code of the kernels.
typedef struct {
  int64_t count, destructor, destructor_data;
  uint32_t data, unused;
  int64_t size;
} Memory;

Memory *NRT_MemInfo_alloc(int64_t size) {
  Memory *memory = malloc(sizeof(Memory) + size);
  *memory = (Memory){.count = 1, .data = (uint32_t)(memory + 1), .size = size};
  return memory;
}

Memory *NRT_MemInfo_alloc_aligned(int64_t size, int32_t align) {
  return NRT_MemInfo_alloc(size);  // malloc aligns to 16 bytes, which is enough for the vectors of a browser
}

int8_t count_down(int64_t *at, int64_t by, int32_t condition) { return (*at -= by) == 0; }
void NRT_MemInfo_call_dtor(Memory *memory) { free(memory); }
void *NRT_Allocate(int64_t size) { return malloc(size); }
void NRT_Free(void *memory) { free(memory); }

// Writes the strides of a contiguous array of another shape; kernels reshape no other arrays.
int32_t numba_attempt_nocopy_reshape(int64_t axes, const int64_t *lengths, const int64_t *strides, int64_t new_axes,
                                     const int64_t *new_lengths, int64_t *new_strides, int64_t item, int32_t by_column) {
  int64_t step = item;
  for (int64_t k = new_axes - 1; k >= 0; k--) {
    new_strides[k] = step;
    step *= new_lengths[k];
  }
  return 1;
}

// Errors of Numba, which end the game: kernels raise none for valid input.
#define FAIL(result, name, ...) \
  result name(__VA_ARGS__) { __builtin_trap(); }
FAIL(void *, NRT_MemInfo_new_varsize_dtor, int64_t, void *)
FAIL(void *, numba_unpickle, void *, int32_t, void *)
FAIL(void *, numba_runtime_build_excinfo_struct, void *, void *)
FAIL(void, numba_do_raise, void *)
FAIL(void *, PyBytes_FromStringAndSize, void *, int64_t)
FAIL(void, PyErr_SetString, void *, void *)
FAIL(void *, PyUnicode_FromKindAndData, int32_t, void *, int64_t)
FAIL(int64_t, PyObject_Hash, void *)
FAIL(void *, PyTuple_Pack, int64_t, void *)
void *PyExc_RuntimeError;

void cpMessage(const char *condition, const char *file, int line, int is_error, int is_hard, const char *text, ...) {}

// Chipmunk by addresses as int64, as kernels pass them. Vectors are two numbers.
void set_ends(int64_t segment, double ax, double ay, double bx, double by) {
  cpSegmentShapeSetEndpoints((cpShape *)(intptr_t)segment, cpv(ax, ay), cpv(bx, by));
}
void add_shape(int64_t space, int64_t shape) { cpSpaceAddShape((cpSpace *)(intptr_t)space, (cpShape *)(intptr_t)shape); }
void remove_shape(int64_t space, int64_t shape) {
  cpSpaceRemoveShape((cpSpace *)(intptr_t)space, (cpShape *)(intptr_t)shape);
}
void step_space(int64_t space, double seconds) { cpSpaceStep((cpSpace *)(intptr_t)space, seconds); }

// Sets position, velocity and force of a body from six numbers, as pymunk's batches do.
void give_body(int64_t address, int64_t numbers) {
  cpBody *body = (cpBody *)(intptr_t)address;
  const double *given = (const double *)(intptr_t)numbers;
  cpBodySetPosition(body, cpv(given[0], given[1]));
  cpBodySetVelocity(body, cpv(given[2], given[3]));
  cpBodySetForce(body, cpv(given[4], given[5]));
}

void take_body(int64_t address, int64_t numbers) {
  const cpBody *body = (const cpBody *)(intptr_t)address;
  double *taken = (double *)(intptr_t)numbers;
  taken[0] = body->p.x, taken[1] = body->p.y, taken[2] = body->v.x, taken[3] = body->v.y;
}

// Makes Chipmunk's objects for `HANDLES` of world/navigation/physics.py, and the shapes of walls.
void make_contacts(int64_t *handles, int64_t *segments, double *given, double *taken, int count, double radius_m,
                   double mass_kg, double slop_m) {
  static int32_t unused;  // pymunk's batches count numbers here
  static cpSpace *space;  // these are of the last round
  static cpBody *body;
  static cpShape *circle;
  static cpSegmentShape *walls;
  if (space) cpSpaceFree(space), cpBodyFree(body), cpShapeFree(circle), free(walls);
  space = cpSpaceNew();
  cpSpaceSetCollisionSlop(space, slop_m);
  body = cpSpaceAddBody(space, cpBodyNew(mass_kg, INFINITY));
  circle = cpCircleShapeNew(body, radius_m, cpvzero);
  walls = calloc(count, sizeof(cpSegmentShape));
  handles[0] = (intptr_t)space, handles[1] = (intptr_t)body, handles[2] = (intptr_t)circle;
  handles[3] = (intptr_t)given, handles[5] = (intptr_t)taken;
  handles[4] = handles[6] = (intptr_t)&unused;
  for (int k = 0; k < count; k++)
    segments[k] = (intptr_t)cpSegmentShapeInit(walls + k, cpSpaceGetStaticBody(space), cpvzero, cpv(1, 0), 0);
}
