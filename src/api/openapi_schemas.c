/* What answers look like, and examples of requests: JSON with ' in the place of ". */
#include "api/openapi.h"

#define OBJECT(required, properties) \
    "{'type':'object','additionalProperties':false,'required':[" required "],'properties':{" properties "}}"
#define TIME "{'type':['string','null'],'format':'date-time'}"
#define TEXT_OR_NULL "{'type':['string','null']}"
#define COUNT "{'type':'integer','minimum':0}"
#define REF(name) "{'$ref':'#/components/schemas/" name "'}"
#define LIST(of) "{'type':'array','items':" of "}"
#define POINT "{'type':'array','items':{'type':'number'},'minItems':3,'maxItems':3}"
#define OUTCOME "{'enum':['converged','not_converged',null]}"
#define HASH "{'type':'string','pattern':'^[0-9a-f]{64}$'}"

#define PATHS                                 \
    LIST(OBJECT("'pointer','asked','opened'", \
                "'pointer':{'type':'string'},'asked':{'type':'string'},'opened':{'type':'string'}"))

#define JOB_REQUIRED                                                                                      \
    "'id','name','owner','revision','state','paused','outcome','priority','labels','created','started','" \
    "finished',"                                                                                          \
    "'array','tasks','attempt','max_attempts','threads','memory_mb','retention_s','traceparent','cached_" \
    "from',"                                                                                              \
    "'progress','error','links'"
#define JOB_PROPERTIES                                                                                       \
    "'id':{'type':'string','pattern':'^[0-9a-z]{26}$'},"                                                     \
    "'name':" TEXT_OR_NULL ","                                                                               \
    "'owner':{'type':'string'},"                                                                             \
    "'revision':" COUNT ","                                                                                  \
    "'paused':{'type':'boolean'},"                                                                           \
    "'array':{'type':'boolean'},"                                                                            \
    "'tasks':" REF(                                                                                          \
        "TaskCounts") ","                                                                                    \
                      "'threads':" COUNT ",'memory_mb':" COUNT ",'retention_s':" COUNT ","                   \
                      "'traceparent':" TEXT_OR_NULL ",'cached_from':" TEXT_OR_NULL ","                       \
                      "'state':" REF(                                                                        \
                          "State") ","                                                                       \
                                   "'outcome':" OUTCOME ","                                                  \
                                   "'priority':{'type':'integer'},"                                          \
                                   "'labels':" LIST(                                                         \
                                       "{'type':'string'}") ","                                              \
                                                            "'created':" TIME ",'started':" TIME             \
                                                            ",'finished':" TIME ","                          \
                                                            "'attempt':" COUNT ","                           \
                                                            "'max_attempts':" COUNT ","                      \
                                                            "'progress':{'oneOf':[{'type':'null'}," REF(     \
                                                                "Progress") "]},"                            \
                                                                            "'error':{'oneOf':[{'type':'"    \
                                                                            "null'}," REF(                   \
                                                                                "Error") "]},"               \
                                                                                         "'links':" OBJECT(  \
                                                                                             "'self','"      \
                                                                                             "tasks','"      \
                                                                                             "attempts','"   \
                                                                                             "events','"     \
                                                                                             "log'",         \
                                                                                             "'self':{'"     \
                                                                                             "type':'"       \
                                                                                             "string'},'"    \
                                                                                             "tasks':{'"     \
                                                                                             "type':'"       \
                                                                                             "string'},'"    \
                                                                                             "attempts':{'"  \
                                                                                             "type':'"       \
                                                                                             "string'},"     \
                                                                                             "'events':{'"   \
                                                                                             "type':'"       \
                                                                                             "string'},'"    \
                                                                                             "log':{'type':" \
                                                                                             "'string'},'"   \
                                                                                             "results':{'"   \
                                                                                             "type':'"       \
                                                                                             "string'}")

const openapi_schema openapi_schemas[] = {
    {"Error", OBJECT("'code','message'", "'code':{'type':'string'},'message':{'type':'string'}")},
    {"Progress", "{'type':'object','required':['phase','fraction'],'description':'The worker says more or "
                 "less of these, by phase.',"
                 "'properties':{'phase':{'enum':['load','start','relax','measure','write']},"
                 "'fraction':{'type':'number','minimum':0,'maximum':1}}}"},
    {"Attempt", OBJECT("'number','started','finished'",
                       "'frame':{'type':'integer'},'host':{'type':'string'},'number':" COUNT
                       ",'started':" TIME ",'finished':" TIME ",'exit_status':" COUNT ",'signal':" COUNT
                       ",'peak_memory_bytes':" COUNT ",'reason':{'type':'string'}")},
    {"Attempts", OBJECT("'attempts'", "'attempts':" LIST(REF("Attempt")))},
    {"TaskCounts", OBJECT("'all','waiting','running','succeeded','failed','cancelled','timed_out'",
                          "'all':" COUNT ",'waiting':" COUNT ",'running':" COUNT ",'succeeded':" COUNT
                          ",'failed':" COUNT ",'cancelled':" COUNT ",'timed_out':" COUNT)},
    {"Task",
     OBJECT(
         "'number','state','outcome','attempt','spent','interrupted','not_before','started','finished','error'",
         "'number':" COUNT ",'frame':{'type':'integer'},'state':" REF(
             "State") ",'outcome':" OUTCOME ",'attempt':" COUNT ",'spent':" COUNT ",'interrupted':" COUNT
                      ",'not_before':" TIME ",'started':" TIME ",'finished':" TIME
                      ",'error':{'oneOf':[{'type':'null'}," REF("Error") "]}")},
    {"TaskPage",
     OBJECT("'tasks','next'", "'tasks':" LIST(REF("Task")) ",'next':{'type':['integer','null']}")},
    {"Event",
     OBJECT("'seq','at','job','type','state','outcome'",
            "'seq':" COUNT ",'at':" TIME ",'job':{'type':'string'},'type':{'type':'string'},'state':" REF(
                "State") ",'outcome':" OUTCOME ",'frame':{'type':'integer'},'attempt':" COUNT)},
    {"EventPage",
     OBJECT(
         "'events','next','position'",
         "'events':" LIST(REF(
             "Event")) ",'next':{'type':['integer','null'],'description':'There may be more behind"
                       " it: ask again with it as `after`. A filter may leave a page empty although there is more.'},"
                       "'position':{'type':'integer','minimum':0,'description':'Where to go on later: `after` of the next request.'},"
                       "'removed_up_to':{'type':'integer','description':'Events behind `after` up to this number were removed with"
                       " their jobs; some may be missing here.'},"
                       "'reset':{'const':true,'description':'`after` was not reached yet: the database is older than what it was read"
                       " from (a restored backup). Go on from `position`, and look at the jobs anew.'}")},
    {"Workers",
     OBJECT(
         "'load','workers'",
         "'load':" OBJECT(
             "'attempts','attempts_limit','threads','threads_limit','memory_mb','memory_mb_limit'",
             "'attempts':" COUNT ",'attempts_limit':" COUNT ",'threads':" COUNT ",'threads_limit':" COUNT
             ",'memory_mb':" COUNT
             ",'memory_mb_limit':" COUNT) ",'workers':" LIST(OBJECT("'job','owner','attempt','started','"
                                                                    "threads','memory_mb'",
                                                                    "'job':{'type':'string'},'owner':{'type':"
                                                                    "'string'},'frame':{'type':'integer'},"
                                                                    "'attempt':" COUNT ",'started':" TIME
                                                                    ",'threads':" COUNT
                                                                    ",'memory_mb':" COUNT)))},
    {"JobSummary", OBJECT(JOB_REQUIRED, JOB_PROPERTIES)},
    {"Job", OBJECT(JOB_REQUIRED ",'spec','paths','attempts'", JOB_PROPERTIES
                   ",'spec':{'oneOf':[{'type':'null'}," REF("JobSpec") "]},'paths':" PATHS
                                                                       ",'attempts':" LIST(REF("Attempt")))},
    {"JobPage", OBJECT("'jobs','next'", "'jobs':" LIST(REF("JobSummary")) ",'next':" TEXT_OR_NULL)},
    {"Validation",
     OBJECT(
         "'spec','paths','estimate','estimate_missing'",
         "'spec':" REF("JobSpec") ",'paths':" PATHS ",'estimate':{'oneOf':[{'type':'null'}," REF(
             "Estimate") "]},"
                         "'estimate_missing':{'type':['string','null'],'description':'Why there is none.'}")},
    {"Estimate",
     OBJECT(
         "'count','area','bounding_box','memory_bytes','seconds','seconds_missing','threads'",
         "'count':{'type':['integer','null'],'description':'Points; null when a time is the target.'},"
         "'area':{'type':'number'},"
         "'bounding_box':" OBJECT(
             "'min','max'",
             "'min':" POINT
             ",'max':" POINT) ","
                              "'memory_bytes':" COUNT ","
                              "'seconds':{'type':['number','null'],'description':'That so many processors of this machine take, without"
                              " what writing the results does; null when it cannot be told.'},"
                              "'seconds_missing':{'type':['string','null'],'description':'Why there are none.'},"
                              "'threads':" COUNT)},
    {"Results", OBJECT("'results'", "'results':" LIST(OBJECT(
                                        "'name','bytes','sha256','content_type','href'",
                                        "'name':{'type':'string'},'bytes':" COUNT ",'sha256':" HASH
                                        ",'content_type':{'type':'string'},'href':{'type':'string'}")))},
    {"Input",
     OBJECT("'sha256','bytes','path'",
            "'sha256':" HASH ",'bytes':" COUNT
            ",'path':{'type':'string','description':'What a spec calls it; an ending may follow.'}")},
    {"Health", OBJECT("'status'", "'status':{'enum':['ok','draining']}")},
    {"Readiness", OBJECT("'status','checks'", "'status':{'const':'ok'},'checks':" REF("Checks"))},
    {"Checks",
     "{'type':'object','description':'Each condition of readiness, in a word; ok where all is well.',"
     "'additionalProperties':{'type':'string'}}"},
    {"Drain", OBJECT("'status','running'", "'status':{'enum':['ok','draining']},'running':" COUNT)},
    {"Version", OBJECT("'name','version','api'",
                       "'name':{'type':'string'},'version':{'type':'string'},'api':{'const':'v1'}")},
    {"Openapi", "{'type':'object','required':['openapi','info','paths']}"},
    {"Problem",
     "{'type':'object','required':['type','title','status','detail','code','errors'],'additionalProperties':"
     "false,"
     "'properties':{'type':{'type':'string'},'title':{'type':'string'},'status':{'type':'integer'},"
     "'detail':{'type':'string'},'code':" REF("ProblemCode") ",'checks':" REF("Checks") ",'errors':" LIST(
         OBJECT("'pointer','detail'", "'pointer':{'type':'string'},'detail':{'type':'string'}")) "}}"},
};

const size_t openapi_schema_count = sizeof openapi_schemas / sizeof *openapi_schemas;
