/* Entry point for XLA: splits a batch into blocks of WIDTH samples, one per lane, and distributes blocks over threads.
 *
 * Requires WIDTH, V, KERNEL(V **in, V **out), SPLAT, and for the arguments and results of one sample
 * ARGUMENTS, RESULTS, ARGUMENT_SIZE[], RESULT_SIZE[] (elements), RESULT_RANK (axes of the first result).
 * Leading axes beyond those of a sample are batch axes. A batch axis of length one is shared if the result's is longer.
 */
#if WIDTH == 1
#define LANE(x, i) (x)
#else
#define LANE(x, i) ((x)[i])
#endif

typedef struct {
  const XLA_FFI_CallFrame *frame;
  int64_t first, last; /* blocks */
  int64_t samples;
  int integer_overflow; /* whether an integer exceeded the range that doubles carry exactly */
} Work;

static double load(const XLA_FFI_Buffer *b, int64_t i) {
  switch (b->dtype) {
    case XLA_FFI_DataType_F64: return ((const double *)b->data)[i];
    case XLA_FFI_DataType_S64: {
      const int64_t x = ((const int64_t *)b->data)[i];
      integer_overflow |= x > 9007199254740991 || x < -9007199254740991;
      return (double)x;
    }
    case XLA_FFI_DataType_S32: return (double)((const int32_t *)b->data)[i];
    case XLA_FFI_DataType_U32: return (double)((const uint32_t *)b->data)[i];
    case XLA_FFI_DataType_PRED:
    case XLA_FFI_DataType_U8: return (double)((const uint8_t *)b->data)[i];
    default: return NAN; /* other types are rejected when the function is traced */
  }
}

static void store(const XLA_FFI_Buffer *b, int64_t i, double x) {
  switch (b->dtype) {
    case XLA_FFI_DataType_F64: ((double *)b->data)[i] = x; break;
    case XLA_FFI_DataType_S64: ((int64_t *)b->data)[i] = (int64_t)x; break;
    case XLA_FFI_DataType_S32: ((int32_t *)b->data)[i] = (int32_t)x; break;
    case XLA_FFI_DataType_U32: ((uint32_t *)b->data)[i] = (uint32_t)x; break;
    case XLA_FFI_DataType_PRED:
    case XLA_FFI_DataType_U8: ((uint8_t *)b->data)[i] = (uint8_t)x; break;
    default: break;
  }
}

/* index of the sample of an argument that belongs to a sample of the batch */
static int64_t sample_of(const XLA_FFI_Buffer *b, const XLA_FFI_Buffer *like, int64_t axes, int64_t sample) {
  int64_t index = 0, stride = 1;
  for (int64_t k = axes - 1; k >= 0; k--) {
    int64_t at = sample % like->dims[k];
    sample /= like->dims[k];
    if (b->dims[k] != 1) {
      index += stride * at;
      stride *= b->dims[k];
    }
  }
  return index;
}

static void *work(void *p) {
  Work *w = p;
  integer_overflow = 0;
  const XLA_FFI_CallFrame *f = w->frame;
  const XLA_FFI_Buffer *like = f->rets.rets[0];
  const int64_t axes = like->rank - RESULT_RANK;
  int64_t total = 1;
  for (int i = 0; i < ARGUMENTS; i++) total += ARGUMENT_SIZE[i];
  for (int i = 0; i < RESULTS; i++) total += RESULT_SIZE[i];
  const int direct = WIDTH == 1; /* one sample of doubles is used without a copy */
  V *memory = allocate(total * sizeof(V));
  V *in[ARGUMENTS + 1], *out[RESULTS], *next = memory;
  int own[ARGUMENTS + 1]; /* whether the argument has one value per sample */
  for (int i = 0; i < ARGUMENTS; i++) {
    const XLA_FFI_Buffer *b = f->args.args[i];
    in[i] = next;
    next += ARGUMENT_SIZE[i];
    own[i] = 0;
    for (int64_t k = 0; k < axes; k++) own[i] |= b->dims[k] != 1;
    if (direct && b->dtype == XLA_FFI_DataType_F64)
      in[i] = b->data;
    else if (!own[i])
      for (int64_t e = 0; e < ARGUMENT_SIZE[i]; e++) in[i][e] = SPLAT(load(b, e));
  }
  for (int i = 0; i < RESULTS; i++) {
    const XLA_FFI_Buffer *b = f->rets.rets[i];
    out[i] = direct && b->dtype == XLA_FFI_DataType_F64 ? b->data : next;
    next += RESULT_SIZE[i];
  }
  for (int64_t block = w->first; block < w->last; block++) {
    const int64_t start = block * WIDTH;
    const int lanes = w->samples - start < WIDTH ? (int)(w->samples - start) : WIDTH;
    for (int i = 0; i < ARGUMENTS; i++) {
      if (!own[i]) continue;
      const XLA_FFI_Buffer *b = f->args.args[i];
      for (int l = 0; l < WIDTH; l++) { /* lanes beyond the batch repeat its last sample */
        const int64_t sample = sample_of(b, like, axes, start + (l < lanes ? l : lanes - 1)) * ARGUMENT_SIZE[i];
        if (b->dtype == XLA_FFI_DataType_F64)
          for (int64_t e = 0; e < ARGUMENT_SIZE[i]; e++) LANE(in[i][e], l) = ((const double *)b->data)[sample + e];
        else
          for (int64_t e = 0; e < ARGUMENT_SIZE[i]; e++) LANE(in[i][e], l) = load(b, sample + e);
      }
    }
    KERNEL(in, out);
    for (int i = 0; i < RESULTS; i++) {
      const XLA_FFI_Buffer *b = f->rets.rets[i];
      if (out[i] == b->data) continue;
      for (int l = 0; l < lanes; l++) {
        const int64_t sample = (start + l) * RESULT_SIZE[i];
        if (b->dtype == XLA_FFI_DataType_F64)
          for (int64_t e = 0; e < RESULT_SIZE[i]; e++) ((double *)b->data)[sample + e] = LANE(out[i][e], l);
        else
          for (int64_t e = 0; e < RESULT_SIZE[i]; e++) store(b, sample + e, LANE(out[i][e], l));
      }
    }
  }
  free(memory);
  w->integer_overflow = integer_overflow;
  return NULL;
}

static XLA_FFI_Error *make_error(const XLA_FFI_CallFrame *f, XLA_FFI_Error_Code code, const char *message) {
  XLA_FFI_Error_Create_Args args = {.struct_size = XLA_FFI_Error_Create_Args_STRUCT_SIZE,
                                    .message = message,
                                    .errc = code};
  return f->api->XLA_FFI_Error_Create(&args);
}

__attribute__((visibility("default"))) XLA_FFI_Error *colift_native(XLA_FFI_CallFrame *f) {
  if (f->extension_start && f->extension_start->type == XLA_FFI_Extension_Metadata) {
    XLA_FFI_Metadata *m = ((XLA_FFI_Metadata_Extension *)f->extension_start)->metadata;
    m->api_version.major_version = XLA_FFI_API_MAJOR;
    m->api_version.minor_version = XLA_FFI_API_MINOR;
    return NULL;
  }
  if (f->args.size != ARGUMENTS || f->rets.size != RESULTS || f->attrs.size != 1)
    return make_error(f, XLA_FFI_Error_Code_INVALID_ARGUMENT,
                      "colift codegen: arguments differ from those of the compiled function");
  const int64_t limit = *(const int64_t *)((const XLA_FFI_Scalar *)f->attrs.attrs[0])->value;
  const XLA_FFI_Buffer *like = f->rets.rets[0];
  int64_t samples = 1;
  for (int64_t k = 0; k < like->rank - RESULT_RANK; k++) samples *= like->dims[k];
  const int64_t blocks = (samples + WIDTH - 1) / WIDTH;
  int64_t threads = blocks / 4 < limit ? blocks / 4 : limit; /* starting a thread costs as much as a few blocks */
  if (threads < 1) threads = 1;
  Work w[threads];
  pthread_t thread[threads];
  int started[threads];
  for (int64_t i = 0; i < threads; i++)
    w[i] = (Work){.frame = f, .first = blocks * i / threads, .last = blocks * (i + 1) / threads, .samples = samples};
  for (int64_t i = 1; i < threads; i++) started[i] = pthread_create(&thread[i], NULL, work, &w[i]) == 0;
  work(&w[0]);
  for (int64_t i = 1; i < threads; i++) {
    if (started[i]) pthread_join(thread[i], NULL);
    else work(&w[i]);
  }
  for (int64_t i = 0; i < threads; i++)
    if (w[i].integer_overflow)
      return make_error(f, XLA_FFI_Error_Code_OUT_OF_RANGE,
                        "colift codegen: integer out of its type's range or beyond 2^53, division by zero, or NaN");
  return NULL;
}
